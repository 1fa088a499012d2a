"""`TFMessage`: the real one where tf2_msgs is installed, else one made at run time."""

try:
    from tf2_msgs.msg import TFMessage
except ImportError:
    from dummy_arm.tf.tf_message import TFMessage

__all__ = ['TFMessage']
