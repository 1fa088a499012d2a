"""Frames that always come together keep their samples in common, so that they come in at once."""

from collections.abc import Sequence
from typing import Optional

import numpy as np

from dummy_arm.tf.history import History
from dummy_arm.tf.samples import Samples
from dummy_arm.tf.wire import POSE_BYTES


def in_common(histories: Sequence[object]) -> Optional[Samples]:
    """
    Have the frames of a stream keep their samples in common, if all have come together so far.

    :returns: those, with the poses of a row in the order of the frames; None if they are not.
    """
    moving = [history for history in histories
              if isinstance(history, History) and not history.keeps_apart]
    if len(moving) < len(histories):
        return None
    first = moving[0].place[0]
    if [history.place for history in moving] == [
            (first, offset) for offset in range(0, first.row, POSE_BYTES)]:
        return first
    stamps = first.regular[first.start:]
    for samples, _ in (history.place for history in moving):
        if (samples.row > POSE_BYTES or samples.authority != first.authority or not stamps
                or samples.regular[samples.start:] != stamps):
            return None
    common = Samples(len(moving))
    common.stamps.extend(stamps)
    common.poses += np.stack([
        samples.poses_of(0)[samples.start:] for samples, _ in (
            history.place for history in moving)], axis=1).tobytes()
    common.latest, common.authority = first.latest, first.authority
    for offset, history in enumerate(moving):
        history.place[0].abandoned = True
        history.place = common, offset * POSE_BYTES
    return common
