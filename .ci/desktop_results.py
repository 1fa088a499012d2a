"""Check the results of the step `desktop`: enough tests ran, each skip has a known reason."""

import re
import sys
from xml.etree import ElementTree

LEAST = 1900
REASONS = [
    r"could not import '.*': No module named '(lz4|pypdf|rosbags|tf_transformations|viser)'",
    'dummy-arm-tf2, of compat, is not installed',
    'the command ros2 is not installed',
    'tf2_msgs is installed: its TFMessage is used, none is made at run time',
    'viser, which (makes|serves) the page, is not installed',
]

cases = [*ElementTree.parse(sys.argv[1]).iter('testcase')]
skips = [(f'{case.get("classname")}.{case.get("name")}', skip.text or '')
         for case in cases for skip in case.iter('skipped')]
ran = len(cases) - len(skips)
print(f'{ran} tests ran, {len(skips)} were skipped')
for name, text in skips:
    if not any(re.search(reason, text) for reason in REASONS):
        sys.exit(f'{name} was skipped for a reason that is not in the list: {text}')
if ran < LEAST:
    sys.exit(f'at least {LEAST} tests must run')
