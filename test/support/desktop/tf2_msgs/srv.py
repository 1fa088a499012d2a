"""The service FrameGraph, on the wire a std_srvs/srv/Trigger whose `message` is the YAML."""

from std_srvs.srv import Trigger


class Metaclass_FrameGraph(type):  # noqa: N801
    """Metaclass of service 'FrameGraph'."""

    _TYPE_SUPPORT = None

    @classmethod
    def __import_type_support__(cls):
        """Load the type support; rclpy calls this on demand."""
        Trigger.__class__.__import_type_support__()
        cls._TYPE_SUPPORT = Trigger.__class__._TYPE_SUPPORT


class FrameGraph_Response(Trigger.Response):  # noqa: N801
    """A Trigger's response, whose `message` can also be accessed as `frame_yaml`."""

    __slots__ = []

    @property
    def frame_yaml(self):
        """Message field 'frame_yaml'."""
        return self.message

    @frame_yaml.setter
    def frame_yaml(self, value):
        self.message = value


class FrameGraph(metaclass=Metaclass_FrameGraph):
    """Service class 'FrameGraph'."""

    Request = Trigger.Request
    Response = FrameGraph_Response
    Event = Trigger.Event
