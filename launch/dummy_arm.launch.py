"""The arm, and rviz2 to watch it: `ros2 launch dummy_arm dummy_arm.launch.py`."""

from launch.actions import DeclareLaunchArgument
from launch.conditions import IfCondition
from launch.substitutions import LaunchConfiguration, PathJoinSubstitution
from launch_ros.actions import Node
from launch_ros.parameter_descriptions import ParameterValue
from launch_ros.substitutions import FindPackageShare

from launch import LaunchDescription


def generate_launch_description() -> LaunchDescription:
    """Describe what is started, and its arguments."""
    use_sim_time = {'use_sim_time': LaunchConfiguration('use_sim_time')}
    return LaunchDescription([
        DeclareLaunchArgument('rate', default_value='50.0',
                              description='how often /tf is published (Hz)'),
        DeclareLaunchArgument('rviz', default_value='true',
                              description='whether rviz2 is started (true or false)'),
        DeclareLaunchArgument('frame_prefix', default_value='',
                              description='put before the name of every frame but map'),
        DeclareLaunchArgument('use_sim_time', default_value='false',
                              description='whether the time is taken from /clock (true or false)'),
        Node(
            package='dummy_arm', executable='dummy_arm', output='screen',
            parameters=[use_sim_time, {
                'rate': LaunchConfiguration('rate'),
                # As text, also where it is empty or a number.
                'frame_prefix': ParameterValue(LaunchConfiguration('frame_prefix'),
                                               value_type=str)}]),
        Node(
            package='rviz2', executable='rviz2', output='screen',
            arguments=['-d', PathJoinSubstitution([
                FindPackageShare('dummy_arm'), 'rviz', 'dummy_arm.rviz'])],
            parameters=[use_sim_time], condition=IfCondition(LaunchConfiguration('rviz')))])
