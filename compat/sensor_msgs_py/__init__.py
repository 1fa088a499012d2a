"""The package sensor_msgs_py, whose contents are in its module `point_cloud2`."""
