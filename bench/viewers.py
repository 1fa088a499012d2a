"""
Viewers of the page of web_view, without a browser.

    viewers.py PORT COUNT SECONDS    print how many bytes and updates each of them gets in a second
"""

from contextlib import suppress
from pathlib import Path
import sys
from threading import Thread
from time import monotonic

sys.path.append(str(Path(__file__).parents[1] / 'test' / 'support'))

from viewer import Viewer

#: The time after which all that is sent once has arrived (s).
SETTLING = 6.0


def watch(port: int, seconds: float, results: list[tuple[float, float]]) -> None:
    """Append the number of bytes and of updates in a second."""
    viewer = Viewer(port)

    def receive(duration: float) -> tuple[int, int]:
        size, updates, last, end = viewer.size, 0, None, monotonic() + duration
        while monotonic() < end:
            with suppress(TimeoutError):
                viewer.receive(0.1)
            new = viewer.nodes.get('/world/frames', {}).get('batched_positions')
            updates, last = updates + (new is not last), new
        return viewer.size - size, updates

    receive(SETTLING)
    size, updates = receive(seconds)
    results.append((size / seconds, updates / seconds))
    viewer.close()


if __name__ == '__main__':
    results: list[tuple[float, float]] = []
    threads = [Thread(target=watch, args=(int(sys.argv[1]), float(sys.argv[3]), results))
               for _ in range(int(sys.argv[2]))]
    for thread in threads:
        thread.start()
    for thread in threads:
        thread.join()
    print(*(sum(values) / len(results) for values in zip(*results)))
