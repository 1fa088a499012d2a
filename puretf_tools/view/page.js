// The tree, the findings, the line at the foot and the bar of a bag, which viser has no controls
// for. Python sends what they show as JSON in hidden elements, and gets what is clicked as the
// text of a hidden control. This code runs once for the page, inside of a function.
if (document.getElementById('tf-style')) return;
const style = document.createElement('style');
style.id = 'tf-style';
style.textContent = this.textContent;
document.head.append(style);

const make = (tag, attributes = {}, ...children) => {
  const element = document.createElement(tag);
  for (const [key, value] of Object.entries(attributes)) element.setAttribute(key, value);
  element.append(...children);
  return element;
};

// Set what differs, so that hover and focus stay.
const setText = (element, text) => {
  if (element.textContent != text) element.textContent = text;
};
const setAttribute = (element, name, value) => {
  if (value == null) element.removeAttribute(name);
  else if (element.getAttribute(name) != value) element.setAttribute(name, value);
};

const state = { events: '', rows: [], findings: [], status: [] };
const bar = {};
let last = Date.now(); // when Python sent something
let count = 0;
const send = (action, what = '') =>
  window.__viserMutable?.sendMessage({
    type: 'GuiUpdateMessage',
    uuid: state.events,
    // The number makes each text another one: viser ignores a value that is as before.
    updates: { value: `${Date.now()}.${count++} ${action} ${what}` },
  });

// ---- The tree --------------------------------------------------------------------------------

// What SVG draws in a square of 16 pixels.
const ICONS = {
  eye: 'M1 8s3-5 7-5 7 5 7 5-3 5-7 5-7-5-7-5zM6 8a2 2 0 1 0 4 0a2 2 0 1 0-4 0',
  target: 'M3.5 8a4.5 4.5 0 1 0 9 0a4.5 4.5 0 1 0-9 0M8 1v5M8 10v5M1 8h5M10 8h5',
  play: 'M4 2l9 6-9 6z',
  pause: 'M5 2v12M11 2v12',
  back: 'M13 2L5 8l8 6zM3 2v12',
  next: 'M3 2l8 6-8 6zM13 2v12',
  loop: 'M13 8a5 5 0 1 1-2-4M11 1v3.5H7.5',
};
const draw = (button, name) => {
  if (button.dataset.icon == name) return;
  button.dataset.icon = name;
  button.innerHTML = `<svg viewBox="0 0 16 16" aria-hidden="true"><path d="${ICONS[name]}"/></svg>`;
};
const icon = (name, attributes) => {
  const button = make('button', { type: 'button', class: name, ...attributes });
  draw(button, name);
  return button;
};

const tree = make('div', { role: 'tree', id: 'tf-tree', 'aria-label': 'Frames' });
const search = make('input', { type: 'search', id: 'tf-search', placeholder: 'search',
  'aria-label': 'Search', title: 'words in names; not one behind a hyphen: wheel -left' });
search.addEventListener('input', () => drawTree());
const items = new Map(); // by name: the elements of a row
let focused = ''; // the name of the row that Tab reaches
let unfolded; // the selected name for which others were unfolded
let shown = ''; // the one that was scrolled to
let opened = ''; // the name of the row whose findings are unfolded

const select = (name) => {
  opened = opened == name && name == state.selected ? '' : name;
  send('select', name);
  drawTree();
};

const focus = (name) => {
  send('select', name);
  send('view', 'frame');
};

const newItem = (name) => {
  const item = {
    fold: make('span', { class: 'fold', 'aria-hidden': 'true' }),
    label: make('span', { class: 'name', title: name }, name),
    mark: make('span', { class: 'mark' }),
    rate: make('span', { class: 'rate' }),
    eye: icon('eye', { tabindex: -1 }),
    target: icon('target', { tabindex: -1, title: 'move the camera to it (F)' }),
    note: make('div', { class: 'note' }),
  };
  setAttribute(item.target, 'aria-label', `focus ${name}`);
  item.row = make('div', { role: 'treeitem' }, item.fold, item.label, item.mark, item.rate,
    item.eye, item.target, item.note);
  item.row.addEventListener('click', (event) => {
    focused = name;
    if (item.note.contains(event.target)) return; // a text to be read and copied
    if (item.fold.contains(event.target) && item.row.ariaExpanded) send('fold', name);
    else if (item.eye.contains(event.target)) send(event.shiftKey ? 'branch' : 'hide', name);
    else if (item.target.contains(event.target)) focus(name);
    else select(name);
  });
  return item;
};

const SEVERITIES = { error: '✖', warning: '⚠', info: '•' };
const paragraphs = ([, , evidence, remedy]) => [
  make('p', {}, evidence), ...(remedy ? [make('p', {}, remedy)] : [])];

const drawRow = (item, [name, level, isOpen, rate, age, isHidden, numbers]) => {
  const isSelected = name == state.selected;
  const found = numbers.map((number) => state.findings[number]).filter(Boolean);
  const severity = Object.keys(SEVERITIES).find((each) => found.some(([is]) => is == each));
  setAttribute(item.row, 'aria-level', level + 1);
  setAttribute(item.row, 'aria-selected', isSelected);
  setAttribute(item.row, 'aria-expanded', isOpen);
  setAttribute(item.row, 'class', [severity, isHidden && 'hidden'].filter(Boolean).join(' '));
  setAttribute(item.row, 'style', `--level: ${Math.min(level, 7)}; --age: ${age ?? 0}0%`);
  setAttribute(item.row, 'data-age', age);
  setText(item.fold, isOpen == null ? '' : isOpen ? '▾' : '▸');
  setText(item.mark, severity ? SEVERITIES[severity] : '');
  const titles = found.map(([, title]) => title);
  setAttribute(item.mark, 'title', titles.join(', '));
  setAttribute(item.row, 'aria-label', [name, rate, ...titles].filter(Boolean).join(', '));
  setText(item.rate, rate);
  setAttribute(item.eye, 'aria-label', `${isHidden ? 'show' : 'hide'} ${name}`);
  setAttribute(item.eye, 'title', `${isHidden ? 'show' : 'hide'} (H); with Shift, its branch`);
  const key = name == opened ? JSON.stringify(found.map((each) => each.slice(0, 4))) : '';
  if (item.key != key) {
    item.key = key;
    item.note.replaceChildren(...(key ? found.flatMap((each) => [
      make('b', {}, each[1]), ...paragraphs(each)]) : []));
  }
};

const ancestors = (number) => {
  const found = [number]; // of a row and of those above it
  let level = state.rows[number][1];
  for (let i = number - 1; i >= 0 && level; i--)
    if (state.rows[i][1] < level) {
      found.push(i);
      level = state.rows[i][1];
    }
  return found;
};

// The rows that are seen: those found, with those above them; or else those not folded.
let rows = [];
const seenRows = () => {
  const words = search.value.toLowerCase().split(/\s+/).filter((word) => word && word != '-');
  const has = (name) => words.every((word) =>
    word[0] == '-' ? !name.includes(word.slice(1)) : name.includes(word));
  if (words.length) {
    const found = new Set(state.rows.flatMap(([name], number) =>
      has(name.toLowerCase()) ? ancestors(number) : []));
    return state.rows.filter((_, number) => found.has(number));
  }
  let folded = Infinity;
  return state.rows.filter(([, level, isOpen]) => {
    if (level > folded) return false;
    folded = isOpen == false ? level : Infinity;
    return true;
  });
};

const drawTree = () => {
  rows = seenRows();
  const names = new Set(rows.map(([name]) => name));
  for (const [name, item] of items)
    if (!names.has(name)) {
      item.row.remove();
      items.delete(name);
    }
  if (!names.has(focused)) focused = names.has(state.selected) ? state.selected : [...names][0];
  let next = tree.firstChild;
  for (const row of rows) {
    const item = items.get(row[0]) ?? newItem(row[0]);
    items.set(row[0], item);
    drawRow(item, row);
    setAttribute(item.row, 'tabindex', row[0] == focused ? 0 : -1);
    if (next == item.row) next = next.nextSibling;
    else tree.insertBefore(item.row, next);
  }
  const number = state.rows.findIndex(([name]) => name == state.selected);
  if (unfolded != state.selected && number >= 0) {
    if (unfolded != null) // else the page has just been opened
      for (const row of ancestors(number).slice(1).map((i) => state.rows[i]))
        if (row[2] == false) send('fold', row[0]);
    unfolded = state.selected;
  }
  if (shown != state.selected && items.has(state.selected)) {
    shown = focused = state.selected;
    items.get(shown).row.scrollIntoView({ block: 'nearest' });
  }
};

const focusRow = (number) => {
  const row = rows[Math.min(Math.max(number, 0), rows.length - 1)];
  if (!row) return;
  items.get(focused)?.row.setAttribute('tabindex', -1);
  focused = row[0];
  items.get(focused).row.setAttribute('tabindex', 0);
  items.get(focused).row.focus();
};

tree.addEventListener('keydown', (event) => {
  const number = rows.findIndex(([name]) => name == focused);
  if (number < 0 || event.ctrlKey || event.metaKey || event.altKey) return;
  const [name, level, isOpen] = rows[number];
  const parent = rows.findLastIndex((row, i) => i < number && row[1] < level);
  const keys = {
    ArrowDown: () => focusRow(number + 1),
    ArrowUp: () => focusRow(number - 1),
    Home: () => focusRow(0),
    End: () => focusRow(rows.length),
    ArrowRight: () => (isOpen == false ? send('fold', name) : isOpen && focusRow(number + 1)),
    ArrowLeft: () => (isOpen ? send('fold', name) : parent >= 0 && focusRow(parent)),
    Enter: () => select(name),
    ' ': () => select(name),
    h: () => send('hide', name),
    H: () => send('branch', name),
    f: () => focus(name),
  };
  if (!keys[event.key]) return;
  keys[event.key]();
  event.preventDefault();
  event.stopPropagation(); // the keys of viser and of a bag are for the scene
});

// ---- The findings ----------------------------------------------------------------------------

const findings = make('section', { id: 'tf-findings', 'aria-label': 'Findings' });
const drawFindings = () => {
  const texts = state.findings.map((each) => each.slice(0, 4)); // without since when
  const key = JSON.stringify([state.verdict, state.more, texts]);
  if (findings.key != key) {
    findings.key = key;
    findings.replaceChildren(
      make('p', { class: 'verdict', 'data-text': 'verdict' },
        (state.verdict || 'not examined yet')
        + (state.more ? ` (${state.more} more are not shown)` : '')),
      ...state.findings.map((each) => {
        const [severity, title] = each;
        const name = `${SEVERITIES[severity] ?? ''} ${title}`;
        const button = make('button', { type: 'button' }, name);
        button.addEventListener('click', () => send('finding', title));
        return make('div', {}, button, ...paragraphs(each), make('p', { class: 'since' }));
      }));
  }
  state.findings.forEach(([severity, , , , since, isOver], number) => {
    const finding = findings.children[number + 1];
    setAttribute(finding, 'class', `finding ${isOver ? 'over' : severity}`);
    setText(finding.lastChild, since);
  });
};

// ---- The foot of the page: the bar of a bag, and the status ----------------------------------

const status = make('div', { id: 'tf-status' });
const foot = make('footer', { id: 'tf-foot' }, status);
const drawStatus = () => {
  const late = (Date.now() - last) / 1e3;
  const isLost = late > 2.5;
  document.body.classList.toggle('tf-lost', isLost);
  // A server that has ended closes the connection, and viser dims; a network that is down does not.
  const values = document.querySelector('[data-tf]');
  const link = values?.closest('[style*="opacity: 0.5"]') ? 'connection' : 'update';
  const found = state.findings.filter(([, , , , , isOver]) => !isOver).map(([each]) => each);
  const health = found.length ? `${found.length} finding${found.length > 1 ? 's' : ''}`
    : /^(healthy|nothing found)/.exec(state.verdict)?.[0] ?? 'not examined';
  const worst = ['error', 'warning'].find((each) => found.includes(each))
    ?? (found.length || health == 'healthy' ? 'ok' : '');
  const parts = isLost ? [[`no ${link} for ${late.toFixed(0)} s`, 'error']] : [['connected', 'ok']];
  parts.push(...state.status.map((text) => [text]));
  if (!isLost) parts.splice(-1, 0, [health, worst]);
  const key = JSON.stringify(parts);
  if (status.key == key) return;
  status.key = key;
  status.replaceChildren(...parts.map(([text, kind = '']) => make('span', { class: kind }, text)));
};

let playback; // the elements of the bar, of a bag
const makeBar = () => {
  const button = (name, label, action, what) => {
    const made = icon(name, { 'aria-label': label, title: label });
    made.addEventListener('click', () => send(action, what));
    return made;
  };
  playback = {
    play: button('play', 'play', 'pause'),
    back: button('back', 'step back (B)', 'step', 'back'),
    next: button('next', 'step (N)', 'step', 'next'),
    time: make('input', { type: 'range', min: 0, step: 0.01, 'aria-label': 'Time (s)' }),
    marks: make('div', { class: 'marks' }),
    text: make('output', { 'data-text': 'time' }),
    speed: make('select', { 'aria-label': 'Speed', title: 'speed' }),
    loop: button('loop', 'begin again at the end', 'loop'),
    goal: make('input', { type: 'text', placeholder: 'go to', 'aria-label': 'Go to',
      title: 'go to a time: +12.3, -1, a stamp, or 2025-10-09T08:53:32Z' }),
    problem: make('div', { class: 'problem', 'data-text': 'problem' }),
  };
  const { play, back, next, time, marks, text, speed, loop, goal, problem } = playback;
  time.addEventListener('input', () => send('seek', time.value));
  speed.append(...bar.speeds.map((each) => make('option', { value: each }, `${each} ×`)));
  speed.addEventListener('change', () => send('speed', speed.value));
  goal.addEventListener('change', () => send('goto', goal.value));
  foot.prepend(make('div', { id: 'tf-bar', role: 'group', 'aria-label': 'Playback' },
    play, back, next, make('div', { class: 'track' }, time, marks), text, speed, loop, goal,
    problem));
};

const drawBar = () => {
  if (!playback) makeBar();
  const { play, time, marks, text, speed, loop, problem } = playback;
  draw(play, bar.plays ? 'pause' : 'play');
  setAttribute(play, 'aria-label', bar.plays ? 'pause' : 'play');
  setAttribute(play, 'title', `${bar.plays ? 'pause' : 'play'} (Space)`);
  setAttribute(loop, 'aria-pressed', bar.loops);
  setAttribute(time, 'max', bar.length);
  if (!time.matches(':active')) time.value = bar.position; // nobody drags it
  setText(text, bar.time);
  if (document.activeElement != speed) speed.value = bar.speed;
  setText(problem, bar.problem || bar.reading);
  const key = JSON.stringify([bar.marks, bar.length]);
  if (marks.key == key) return;
  marks.key = key;
  marks.replaceChildren(...bar.marks.map((each) =>
    make('i', { style: `left: ${(100 * each) / bar.length}%` })));
};

window.addEventListener('keydown', (event) => {
  const keys = { ' ': ['pause'], ArrowLeft: ['step', 'back'], ArrowRight: ['step', 'next'] };
  const users = 'input, textarea, select, [role=tree], [role=tab], [role=slider]';
  const isUsed = event.target.closest?.(event.key == ' ' ? `${users}, button, summary` : users);
  if (!playback || !keys[event.key] || isUsed || event.ctrlKey || event.altKey || event.metaKey)
    return;
  send(...keys[event.key]);
  event.preventDefault();
  event.stopPropagation(); // arrows would turn the camera
}, true);

// ---- What viser lacks ------------------------------------------------------------------------

// Names for all controls: viser's fields and sliders do not belong to their labels, and its
// buttons with an icon have no text.
const fields = 'input, textarea, [role=slider]';
const name = () => {
  for (const label of document.querySelectorAll('label[for]')) {
    let row = label;
    while (row.parentElement && !row.querySelector(fields)) row = row.parentElement;
    if (row.querySelectorAll('label[for]').length == 1) // else this label has no field
      for (const field of row.querySelectorAll(fields))
        if (!field.getAttribute('aria-label'))
          field.setAttribute('aria-label', label.textContent);
  }
  for (const svg of document.querySelectorAll('button:not([aria-label]) svg')) {
    const button = svg.closest('button');
    const kind = svg.classList[1]?.slice('tabler-icon-'.length);
    if (kind || button.matches('.mantine-CloseButton-root'))
      button.setAttribute('aria-label', button.textContent || kind || 'close');
  }
};

const seen = {};
const read = (kind, values) => {
  const text = document.querySelector(`[data-tf=${kind}]`)?.textContent;
  if (!text || text == seen[kind]) return false;
  seen[kind] = text;
  Object.assign(values, JSON.parse(text));
  last = Date.now();
  return true;
};
const update = () => {
  name();
  const page = document.querySelector('.tf-page');
  if (page && !page.contains(tree)) page.append(search, tree, findings);
  if (read('state', state)) {
    drawTree();
    drawFindings();
    drawStatus();
  }
  if (read('bar', bar)) drawBar();
  if (playback && !document.querySelector('[data-tf=bar]')) { // another server, without a bag
    document.getElementById('tf-bar').remove();
    playback = seen.bar = undefined;
  }
};

document.body.append(foot);
setInterval(drawStatus, 500);
new MutationObserver(update).observe(document.body, { childList: true, subtree: true });
update();
