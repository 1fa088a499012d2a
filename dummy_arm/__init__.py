"""TF of ROS 2 in pure Python, and a small robot arm that waves, published as TF."""
