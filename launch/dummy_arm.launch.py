"""Launch the arm and rviz2: `ros2 launch dummy_arm dummy_arm.launch.py`."""

from launch.actions import DeclareLaunchArgument
from launch.conditions import IfCondition
from launch.substitutions import LaunchConfiguration, PathJoinSubstitution
from launch_ros.actions import Node
from launch_ros.parameter_descriptions import ParameterValue
from launch_ros.substitutions import FindPackageShare

from launch import LaunchDescription


def generate_launch_description() -> LaunchDescription:
    """Return the launch arguments and the nodes to start."""
    use_sim_time = {'use_sim_time': LaunchConfiguration('use_sim_time')}
    return LaunchDescription([
        DeclareLaunchArgument('rate', default_value='50.0',
                              description='rate of the messages on /tf (Hz)'),
        DeclareLaunchArgument('rviz', default_value='true',
                              description='whether to start rviz2 (true or false)'),
        DeclareLaunchArgument('frame_prefix', default_value='',
                              description='prefix for the name of every frame except map'),
        DeclareLaunchArgument('use_sim_time', default_value='false',
                              description='whether to take the time from /clock (true or false)'),
        Node(
            package='dummy_arm', executable='dummy_arm', output='screen',
            parameters=[use_sim_time, {
                'rate': LaunchConfiguration('rate'),
                # Without the type, launch_ros would not read every prefix as a string.
                'frame_prefix': ParameterValue(LaunchConfiguration('frame_prefix'),
                                               value_type=str)}]),
        Node(
            package='rviz2', executable='rviz2', output='screen',
            arguments=['-d', PathJoinSubstitution([
                FindPackageShare('dummy_arm'), 'rviz', 'dummy_arm.rviz'])],
            parameters=[use_sim_time], condition=IfCondition(LaunchConfiguration('rviz')))])
