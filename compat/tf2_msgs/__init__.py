"""The package tf2_msgs without its services and actions, which only ROS can provide."""
