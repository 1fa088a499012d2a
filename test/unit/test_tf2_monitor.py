"""The table of `tf2_monitor`."""

from puretf_tools.commands.tf2_monitor import format_traffic
from puretf_tools.inspection.traffic import NodeTraffic, Summary


def test_lines():
    """The columns of the table fit the longest name; unusual rows are marked."""
    moving = Summary(50.04, 0.00123449, 0.25)
    all_of_a_node = Summary(None, -1000000.5, 12345678.25)
    assert format_traffic([
        NodeTraffic('base_link', '/arm', True, True, None, None, 1),
        NodeTraffic('base_link', '/before', True, False, None, None, 0),
        NodeTraffic('joint\n1', '/arm', False, True, moving, 0.01, 1),
        NodeTraffic('joint\n1', '/before', False, False, moving, 0.01, 0),
        NodeTraffic('tool', '/arm', False, True, moving, 0.01, 1),
        NodeTraffic('tool', '/b', False, True, moving, 0.01, 1),
        NodeTraffic('tool', '/silent', False, True, None, 71.26, 0),
        NodeTraffic('tool', '/uncounted', False, True, None, None, 0),
        NodeTraffic('twice', '/arm', False, True, moving, 0.01, 2),
        NodeTraffic('', '/arm', False, True, all_of_a_node, 0.01, 1)]) == [
        'Warning: tool is published by /arm and /b; a frame should have one publisher',
        'Warning: twice is published by /arm (2 publishers); a frame should have one publisher',
        '',
        'Frames:           rate   average delay     max delay  published by',
        '  base_link     static                                /arm',
        '  base_link     static                                /before (gone)',
        '  joint\\n1     50.0 Hz      0.001234 s    0.250000 s  /arm',
        '  joint\\n1     50.0 Hz      0.001234 s    0.250000 s  /before (gone)',
        '  tool         50.0 Hz      0.001234 s    0.250000 s  /arm',
        '  tool         50.0 Hz      0.001234 s    0.250000 s  /b',
        '  tool                      last received 71.3 s ago  /silent',
        '  tool                                                /uncounted',
        '  twice        50.0 Hz      0.001234 s    0.250000 s  /arm',
        '',
        'All Broadcasters:       rate   average delay     max delay        node',
        '                        ? Hz -1000000.500000 s 12345678.250000 s  /arm']
