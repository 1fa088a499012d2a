"""
Measure the page while a node publishes 1000 new frames a second, as by a mistake in their names.

`new_frames.py SECONDS` prints the memory and the CPU of web_view every half minute. One viewer,
not a browser, looks at the page.
"""

import os
from pathlib import Path
import subprocess
import sys
from threading import Thread
from time import monotonic, sleep, time_ns

os.environ.setdefault('ROS_AUTOMATIC_DISCOVERY_RANGE', 'LOCALHOST')
os.environ.setdefault('ROS_DOMAIN_ID', '98')

from measure import cpu_seconds, resident
import rclpy

from puretf import Transform, TransformBroadcaster

VIEWERS = str(Path(__file__).with_name('viewers.py'))
CODE = 'import sys, puretf_tools.entry_points as e; sys.exit(e.web_view())'
RATE, EACH = 10.0, 100  # messages a second, and new frames in a message
PERIOD = 30.0


def report(pid: int, seconds: float) -> None:
    begin, used = monotonic(), cpu_seconds(pid)
    while monotonic() < begin + seconds:
        sleep(PERIOD)
        before, used = used, cpu_seconds(pid)
        print(f'{monotonic() - begin:.0f} s: {resident(pid):.0f} MiB, '
              f'{(used - before) / PERIOD * 100:.0f} % of a core', flush=True)


def main(seconds: float) -> None:
    rclpy.init()
    broadcaster = TransformBroadcaster(rclpy.create_node('new_frames'))
    view = subprocess.Popen([sys.executable, '-c', CODE], stdout=subprocess.PIPE, text=True)
    assert view.stdout
    port = view.stdout.readline().rpartition(':')[2].strip()
    viewer = subprocess.Popen([sys.executable, VIEWERS, port, '1', str(seconds)],
                              stdout=subprocess.DEVNULL)
    sleep(5.0)
    reporting = Thread(target=report, args=(view.pid, seconds))
    reporting.start()
    begin = monotonic()
    for number in range(round(seconds * RATE)):
        broadcaster.sendTransform([Transform(
            time_ns(), 'root', f'new_{number}_{i}').to_message() for i in range(EACH)])
        sleep(max(0.0, begin + (number + 1) / RATE - monotonic()))
    reporting.join()
    viewer.wait()
    view.terminate()
    view.wait()


if __name__ == '__main__':
    main(float(sys.argv[1]))
