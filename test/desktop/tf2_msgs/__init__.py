"""
A stand-in for tf2_msgs, where that cannot be had; found by PYTHONPATH.

It has what a Jazzy desktop has and the TFMessage made at run time has not: a message class whose
type support is loaded only when it is asked for, and whose float64 fields are converted by
compiled code without a check; and the service FrameGraph.
"""
