"""Names of others in the output of a command cannot control the terminal."""

from threading import Thread

from cli_runner import call
from ros_node import eventually

from puretf import TFMessage
from puretf._core.pose import Row
from puretf._wire import cdr
from puretf_tools.commands.tf2_echo import main

S = 10**9
STILL = (0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 1.0)


def test_tf2_echo_escapes_what_others_named(ros, domain_id):
    """The error about a loop lists all frames, each in a line of its own in the log."""
    publisher = ros.node.create_publisher(TFMessage, '/tf', 10)
    has_loop = False

    def send():
        eventually(lambda: publisher.get_subscription_count() == 1)
        publisher.publish(cdr.pack([
            Row(S, 'map', 'tool\x1b[31m', STILL), Row(S, 'a\x1b[2J', 'b\x07', STILL)]))

    def until(text):
        nonlocal has_loop
        if 'At time 1.0' in text and not has_loop:
            has_loop = True
            publisher.publish(cdr.pack([
                Row(S, 'b\x07', 'a\x1b[2J', STILL),
                Row(2 * S, 'a\x1b[2J', 'tool\x1b[31m', STILL)]))
        return r'Frame b\x07 exists with parent a\x1b[2J.' in text

    thread = Thread(target=send)
    thread.start()
    result = call(main, 'map', 'tool\x1b[31m', domain=domain_id, until=until)
    thread.join()
    text = result.stdout + result.stderr
    assert 'Exception thrown' in text
    assert '\x1b[2J' not in text
    assert '\x07' not in text
