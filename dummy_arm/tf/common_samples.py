"""Frames that always come together keep their samples in common, so that they come in at once."""

from collections.abc import Sequence
from typing import Optional
from weakref import ref

import numpy as np

from dummy_arm.tf.history import History
from dummy_arm.tf.samples import Samples
from dummy_arm.tf.wire import POSE_BYTES


def in_common(histories: Sequence[Optional[History]], may_begin: bool) -> Optional[Samples]:
    """
    Have the frames of a stream keep their samples in common, if all have come together so far.

    :param may_begin: whether they may begin to; it copies their samples.
    :returns: those, with the poses of a row in the order of the frames; None if they are not.
    """
    moving = [history for history in histories if history is not None]
    if len(moving) < len(histories):
        return None
    first = moving[0].place[0]
    if [history.place for history in moving] == [
            (first, offset) for offset in range(0, first.row, POSE_BYTES)]:
        return first
    stamps = first.regular[first.start:]
    if not may_begin or not stamps or any(
            samples.row > POSE_BYTES or samples.authority != first.authority
            or samples.regular[samples.start:] != stamps
            for samples, _ in (history.place for history in moving)):
        return None
    common = Samples(len(moving))
    common.stamps.extend(stamps)
    common.poses += np.stack([
        samples.poses_of(0)[samples.start:] for samples, _ in (
            history.place for history in moving)], axis=1).tobytes()
    common.latest, common.authority = first.latest, first.authority
    common.histories = list(map(ref, moving))
    for column, history in enumerate(moving):
        history.place = common, column * POSE_BYTES
    return common
