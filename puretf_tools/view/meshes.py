"""
The meshes that descriptions of robots name: found below a search path, and loaded once.

A process of its own loads them, which ends if a file takes more memory or time than allowed.
`load` talks to it by pipes: the paths, one per line as JSON, and pickled meshes or reasons.
"""

from collections.abc import Iterable, Sequence
from contextlib import suppress
from io import BytesIO
import json
import logging
from math import isfinite
import os
from pathlib import Path
import pickle
from queue import SimpleQueue
import re
import signal
import subprocess
import sys
from threading import Lock, Thread
from typing import Any, NamedTuple, Optional, Union
from urllib.parse import unquote
from xml.etree import ElementTree

import numpy as np
from numpy.typing import NDArray

from puretf._text.names import quoted
from puretf_tools.robot.shapes import Rgba

#: The formats that are loaded, by the end of the file's name.
FORMATS = '.stl', '.dae', '.obj', '.ply', '.glb', '.off'
#: The largest size of a file (bytes), and the largest number of triangles of a mesh.
MAX_BYTES, MAX_FACES = 50_000_000, 2_000_000
#: The longest time (s) and the largest address space (bytes) in which a mesh is loaded.
_SECONDS, _MEMORY = 20, 2 * 2**30
_LFS = b'version https://git-lfs.github.com/spec/'
_REMEDY = 'simplify it, or export it again'
#: The scheme, or '' of a relative path, and the rest. RFC 3986 has no colon at its beginning.
_NAME = re.compile(r'(?:(package|file)://|(?![^/]*:|$))(.*)', re.DOTALL)
_PASS = 'pass --meshes DIR, where DIR has the package or the file'


class MeshError(Exception):
    """A mesh cannot be shown; the text says why, and what to do."""


class Mesh(NamedTuple):
    vertices: NDArray[np.float32]  #: (n, 3): x, y, z (m)
    faces: NDArray[np.uint32]  #: (m, 3): indices of vertices
    rgba: Optional[Rgba]  #: None if it has no color, or several ones


class Meshes:
    """The meshes below the directories of a search path, by their file in a description."""

    def __init__(self, directories: Iterable[str] = (), waits: bool = False) -> None:
        """
        Search these directories, then `share` of each prefix of a ROS environment.

        :param waits: whether `get` waits until a mesh is loaded.
        """
        prefixes = os.environ.get('AMENT_PREFIX_PATH', '').split(os.pathsep)
        self._directories = [Path(os.path.abspath(directory)) for directory in (
            *directories, *(os.path.join(prefix, 'share') for prefix in prefixes if prefix))]
        #: By file; None: it is being loaded.
        self._loaded: dict[str, Union[Mesh, MeshError, None]] = {}
        self._wanted: SimpleQueue[str] = SimpleQueue()
        self._waits = waits
        if not waits:
            Thread(target=self._load_wanted, daemon=True).start()

    def get(self, file: str) -> Union[Mesh, MeshError, None]:
        """Return a mesh, or why there is none; None: a thread loads it, ask again later."""
        if file not in self._loaded:
            self._loaded[file] = None
            (self._load if self._waits else self._wanted.put)(file)
        return self._loaded[file]

    def forget_failures(self) -> None:
        """Try again to load the meshes that could not be loaded, when they are asked for."""
        for file, mesh in [*self._loaded.items()]:
            if isinstance(mesh, MeshError):
                del self._loaded[file]

    def _load(self, file: str) -> None:
        try:
            self._loaded[file] = load(self.find(file))
        except MeshError as error:
            self._loaded[file] = error

    def _load_wanted(self) -> None:
        while True:
            self._load(self._wanted.get())
            if self._wanted.empty():
                end()

    def find(self, file: str) -> Path:
        """
        Return the path of a file that a description names.

        Only files below the directories are found. Links in the directories are followed: they
        belong to the user, not to who has sent the description.

        :param file: `package://PACKAGE/PATH`, `file:///PATH` or a relative path.
        """
        found = _NAME.fullmatch(file)
        name = unquote(found[2]) if found else ''
        if not found or '\0' in name or (found[1] == 'file') != name.startswith('/'):
            raise MeshError(
                'only package://PACKAGE/PATH, file:///PATH and relative paths are read')
        if not found[1]:  # relative to a file below or beside a directory
            name = re.sub(r'\A(\.\./)+', '', os.path.normpath(name))
        # os.path.join takes an absolute path as it is.
        paths = [Path(os.path.normpath(os.path.join(directory, name)))
                 for directory in self._directories]
        allowed = [path for path in paths if any(
            directory in path.parents for directory in self._directories)]
        if paths and not allowed:
            raise MeshError(f'it is not below a directory of the search path: {_PASS}')
        for path in allowed:
            if os.path.isfile(path):  # Path.is_file raises an error for a name that is too long
                return path
        searched = ', '.join(map(str, self._directories))
        raise MeshError(f'there is no such file below {searched}: {_PASS}' if searched else
                          f'there is no directory to search: {_PASS}')


#: The program of the process, whose arguments are where modules are found.
_PROGRAM = f'import sys; sys.path[:] = sys.argv[1:]; from {__name__} import serve; serve()'
_lock = Lock()
_process: Optional['subprocess.Popen[bytes]'] = None


def load(path: Path, seconds: int = _SECONDS) -> Mesh:
    """Load a mesh within a time; trimesh gets the bytes of this file, and reads no others."""
    global _process
    with _lock:
        if _process is None:
            # Ctrl-C does not reach a session of its own; the end of its input ends the process.
            _process = subprocess.Popen(
                [sys.executable, '-c', _PROGRAM, *sys.path], stdin=subprocess.PIPE,
                stdout=subprocess.PIPE, stderr=subprocess.DEVNULL, start_new_session=True,
                env={**os.environ, 'OPENBLAS_NUM_THREADS': '1'})
        assert _process.stdin
        assert _process.stdout
        try:
            _process.stdin.write(json.dumps([str(path), seconds]).encode() + b'\n')
            _process.stdin.flush()
            found: Union[Mesh, MeshError] = pickle.load(_process.stdout)
        except (EOFError, OSError, pickle.UnpicklingError):
            _process.kill()
            _process.communicate()
            code, _process = _process.returncode, None
            why = f'takes more than {seconds} s' if code == -getattr(signal, 'SIGALRM', 0) else (
                f'ends the process that loads it ({code})')
            raise MeshError(f'it {why}: {_REMEDY}') from None
    if isinstance(found, MeshError):
        raise found
    return found


def end() -> None:
    """End the process until a mesh is loaded again."""
    global _process
    with _lock:
        if _process:
            _process.communicate()
            _process = None


def serve() -> None:
    """Load the meshes that are asked for on stdin."""
    import trimesh  # noqa: F401  (before memory and time are limited)
    output = os.fdopen(os.dup(1), 'wb')
    os.dup2(2, 1)  # libraries may print
    logging.getLogger('trimesh').setLevel(logging.CRITICAL)
    alarm = getattr(signal, 'alarm', int)
    with suppress(ImportError, ValueError):  # Windows has no limits, and macOS not this one
        import resource
        resource.setrlimit(resource.RLIMIT_AS, (_MEMORY, _MEMORY))
    for line in sys.stdin:
        path, seconds = json.loads(line)
        alarm(seconds)  # which ends this process
        try:
            found: Union[Mesh, MeshError] = _load(Path(path))
        except MeshError as error:
            found = error
        except MemoryError:
            found = MeshError(f'it takes more than {_MEMORY // 2**30} GB: {_REMEDY}')
        alarm(0)
        pickle.dump(found, output)
        output.flush()


def _load(path: Path) -> Mesh:
    kind = path.suffix.lower()
    if kind not in FORMATS:
        raise MeshError(f'the format {kind!r:.20} is not read: convert it to one of '
                        f'{", ".join(FORMATS)}')
    try:
        with path.open('rb') as file:
            data = file.read(MAX_BYTES + 1)
    except OSError as error:
        raise MeshError(f'{path} cannot be read: {error.strerror or error}') from None
    if len(data) > MAX_BYTES:
        raise MeshError(f'it has more than {MAX_BYTES // 10**6} MB: simplify it')
    if data.startswith(_LFS):
        raise MeshError(f'{path} is a Git LFS pointer: git lfs pull')
    try:
        mesh = _joined(_parts(kind, data), _unit(data) if kind == '.dae' else 1.0)
    except (MeshError, MemoryError):
        raise
    except ImportError as error:
        raise MeshError('.dae files need pycollada: pip install pycollada, or convert it to .stl'
                        if kind == '.dae' else f'{error}: convert it to .stl') from None
    except Exception as error:  # trimesh and its libraries raise errors of many types
        text = ' '.join(f'{type(error).__name__}: {error}'.split())
        raise MeshError(f'it cannot be loaded ({text:.200}): open it with another program, and '
                        'save it as .stl') from None
    if not len(mesh.faces) or not np.isfinite(mesh.vertices).all():
        raise MeshError('it has no triangles, or numbers that are not finite: export it again')
    return mesh


def _unit(data: bytes) -> float:
    text = next((element.get('meter', '1') for _, element in ElementTree.iterparse(
        BytesIO(data), ['start']) if element.tag.rpartition('}')[2] == 'unit'), '1')
    with suppress(ValueError):
        if isfinite(unit := float(text)) and unit > 0.0:
            return unit
    raise MeshError(f'its unit must be a positive number of metres, got {quoted(text)}: write '
                    '<unit meter="1"/>')


def _parts(kind: str, data: bytes) -> list[tuple[NDArray[np.float64], Any]]:
    import trimesh

    # The wrong indices of a .ply file would be gone after processing.
    scene = trimesh.load_scene(BytesIO(data), file_type=kind[1:], process=False)
    parts = [(matrix, scene.geometry[name])
             for matrix, name in map(scene.graph.get, scene.graph.nodes_geometry)
             if isinstance(scene.geometry[name], trimesh.Trimesh)]
    if (sum(len(part.faces) for _, part in parts) > MAX_FACES  # a part may be used often
            or sum(len(part.vertices) for _, part in parts) > 3 * MAX_FACES):
        raise MeshError(f'it has more than {MAX_FACES} triangles or {3 * MAX_FACES} vertices: '
                        'simplify it')
    for _, part in parts:
        if len(part.faces) and not 0 <= part.faces.min() <= part.faces.max() < len(part.vertices):
            raise MeshError(f'a triangle of it has the vertices {part.faces.min()} to '
                            f'{part.faces.max()}, but there are 0 to {len(part.vertices) - 1}: '
                            'export it again')
        part.process()
    return parts


def _joined(parts: Sequence[tuple[NDArray[np.float64], Any]], unit: float) -> Mesh:
    """
    Join meshes; trimesh itself would need scipy for some of them.

    assimp, which rviz2 uses, scales COLLADA by its unit; like it, ignore the up axis.
    """
    vertices, faces, count = [np.empty((0, 3))], [np.empty((0, 3), np.int64)], 0
    for matrix, part in parts:
        vertices.append(unit * (part.vertices @ matrix[:3, :3].T + matrix[:3, 3]))
        faces.append(part.faces + count)
        count += len(part.vertices)
    colors = {_color(part.visual) for _, part in parts}
    return Mesh(
        np.concatenate(vertices).astype(np.float32), np.concatenate(faces).astype(np.uint32),
        colors.pop() if len(colors) == 1 else None)


def _color(visual: Any) -> Optional[Rgba]:
    """Return the most frequent color; None: there is none."""
    color = (getattr(visual.material, 'baseColorFactor', None) if visual.kind == 'texture' else
             visual.main_color if visual.kind else None)
    if color is None:
        return None
    red, green, blue, alpha = (np.asarray(color) / 255.0).tolist()
    return red, green, blue, alpha
