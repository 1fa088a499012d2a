"""Launch the arm as a body, and rviz2: `ros2 launch dummy_arm dummy_arm.launch.py`."""

from ament_index_python.packages import get_package_share_path
from launch.actions import DeclareLaunchArgument
from launch.conditions import IfCondition
from launch.substitutions import LaunchConfiguration
from launch_ros.actions import Node
from launch_ros.parameter_descriptions import ParameterValue

from launch import LaunchDescription


def generate_launch_description() -> LaunchDescription:
    """Return the launch arguments and the nodes to start."""
    use_sim_time = {'use_sim_time': LaunchConfiguration('use_sim_time')}
    # Without the type, launch_ros would not read every text as a string.
    frame_prefix = {'frame_prefix': ParameterValue(LaunchConfiguration('frame_prefix'),
                                                   value_type=str)}
    share = get_package_share_path('dummy_arm')
    urdf = share / 'urdf' / 'dummy_arm.urdf'
    return LaunchDescription([
        DeclareLaunchArgument('rate', default_value='50.0',
                              description='rate of the messages on /tf (Hz)'),
        DeclareLaunchArgument('rviz', default_value='true',
                              description='whether to start rviz2 (true or false)'),
        DeclareLaunchArgument('frame_prefix', default_value='',
                              description='prefix for the name of every frame except map; in '
                                          'rviz2, set it as the TF Prefix of RobotModel, too'),
        DeclareLaunchArgument('use_sim_time', default_value='false',
                              description='whether to take the time from /clock (true or false)'),
        Node(
            package='dummy_arm', executable='dummy_arm', output='screen',
            # robot_state_publisher sends the transforms: each frame has one publisher.
            parameters=[use_sim_time, frame_prefix, {
                'rate': LaunchConfiguration('rate'),
                'publish_tf': False, 'publish_description': False}]),
        Node(
            package='dummy_arm', executable='robot_state_publisher', output='screen',
            # Without ignore_timestamp, it would send fewer messages than it receives.
            parameters=[use_sim_time, frame_prefix, {
                'ignore_timestamp': True,
                'robot_description': ParameterValue(urdf.read_text(), value_type=str)}]),
        Node(
            package='rviz2', executable='rviz2', output='screen',
            arguments=['-d', str(share / 'rviz' / 'dummy_arm.rviz')],
            parameters=[use_sim_time], condition=IfCondition(LaunchConfiguration('rviz')))])
