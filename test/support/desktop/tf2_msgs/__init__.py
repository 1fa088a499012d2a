"""
A stand-in for tf2_msgs, for machines without it; PYTHONPATH makes it importable.

It has what a Jazzy desktop has and the TFMessage made at run time lacks: a message class whose
type support is loaded only on demand, and whose float64 fields are converted by compiled code
without a check; and the service FrameGraph.
"""
