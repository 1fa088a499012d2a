"""The frames that viewers place by hand, published on /tf_static."""

from typing import TYPE_CHECKING

from puretf import Transform, visible
from puretf_tools.inspection.forest import self_and_ancestors

if TYPE_CHECKING:
    from puretf import StaticTransformBroadcaster
    from puretf_tools.inspection.frame_listener import FrameListener


class HandPublisher:
    """Publishes the frames that viewers place by hand, each with a publisher of its own."""

    def __init__(self, frame_listener: 'FrameListener') -> None:
        self._frame_listener = frame_listener
        #: By frame: who publishes it.
        self._broadcasters: dict[str, tuple[object, StaticTransformBroadcaster]] = {}
        #: The frames that have been published.
        self._published: set[str] = set()

    def send(self, transform: Transform, owner: object) -> str:
        """Publish a transform of an owner, and return ''; or return why it is refused."""
        from geometry_msgs.msg import TransformStamped

        from puretf import StaticTransformBroadcaster
        node, name = self._frame_listener.node, transform.child_frame_id
        if self._broadcasters.get(name, (owner,))[0] is not owner:
            return f'another viewer publishes frame {visible(name)} already'
        if why := self._why_refused(transform):
            return why
        message = TransformStamped(child_frame_id=name)
        message.header.frame_id = transform.frame_id
        message.header.stamp = node.get_clock().now().to_msg()
        t, r = message.transform.translation, message.transform.rotation
        t.x, t.y, t.z = transform.translation
        r.x, r.y, r.z, r.w = transform.rotation
        if name not in self._broadcasters:
            self._broadcasters[name] = owner, StaticTransformBroadcaster(node)
        try:
            self._broadcasters[name][1].sendTransform(message)
        except ValueError as error:  # such as a name of a parent that is not valid Unicode
            self.stop(name)
            return str(error)
        self._published.add(name)
        return ''

    def stop(self, name: str) -> None:
        """Stop publishing a frame: listeners that start later do not receive it."""
        if found := self._broadcasters.pop(name, None):
            self._frame_listener.node.destroy_publisher(found[1].pub_tf)

    def _why_refused(self, transform: Transform) -> str:
        """Return which node publishes the frame already, or that there would be a loop; or ''."""
        frames = {frame.name: frame for frame in self._frame_listener.buffer.frames()}
        name = transform.child_frame_id
        if name in self_and_ancestors(transform.frame_id, frames):
            return (f'frame {visible(name)} is above {visible(transform.frame_id)}: there would '
                    'be a loop')
        if name not in frames:
            return ''
        listener, gid = self._frame_listener, frames[name].authority
        publisher = listener.names_of([gid])[gid]
        # After our own message, the name is our own, or not known exactly, as with Cyclone DDS.
        is_own = name in self._published and (
            not publisher.startswith('/')
            or publisher == self._frame_listener.node.get_fully_qualified_name())
        # A frame whose publisher has ended can be published by another one.
        if is_own or listener.is_present(gid) is False:
            return ''
        return f'{visible(publisher)} publishes frame {visible(name)} already'
