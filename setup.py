from setuptools import find_packages, setup

package_name = 'dummy_arm'

setup(
    name=package_name,
    version='0.1.0',
    packages=find_packages(include=[package_name, f'{package_name}.*']),
    package_data={package_name: ['py.typed']},
    data_files=[
        ('share/ament_index/resource_index/packages', [f'resource/{package_name}']),
        (f'share/{package_name}', ['package.xml']),
        (f'share/{package_name}/launch', ['launch/dummy_arm.launch.py']),
        (f'share/{package_name}/rviz', ['rviz/dummy_arm.rviz']),
    ],
    python_requires='>=3.10',
    install_requires=['numpy>=1.26', 'setuptools', 'transforms3d>=0.4'],
    extras_require={
        # Bounded above is what is not public and used all the same; see test/test_private_apis.py.
        'ros': ['ros-jazzy-common-interfaces>=5.3,<6', 'ros-jazzy-rclpy[fastrtps]>=7.1,<7.2',
                'matplotlib', 'pygraphviz', 'pypdf', 'pyyaml', 'tqdm'],
        'view': ['viser>=1.1,<1.2', 'websockets<17'],
        'bag': ['backports.zstd; python_version < "3.14"', 'lz4', 'matplotlib', 'mcap',
                'pygraphviz', 'pypdf', 'rosbags', 'ruamel.yaml', 'tqdm'],
        'bench': ['matplotlib', 'transform-tree==0.0.9; sys_platform == "linux"'],
        'fuzz': ['atheris>=3,<4; sys_platform == "linux" and python_version >= "3.11"'],
        'pictures': ['matplotlib', 'pillow', 'pypdfium2'],
        'test': ['colcon-common-extensions', 'hypothesis', 'mypy', 'playwright', 'pypdf', 'pytest',
                 'pytest-xdist', 'ruff', 'wheel'],
    },
    zip_safe=True,
    maintainer='dummy_arm developers',
    maintainer_email='dummy-arm@example.org',
    description='A small arm that waves, published as TF, and TF itself in pure Python.',
    license='MIT',
    entry_points={
        'console_scripts': [
            f'{command} = dummy_arm.cli.entry_points:{command}' for command in (
                'check_arm', 'dummy_arm', 'dynamic_tf_publisher', 'param',
                'static_transform_publisher', 'tf2_echo', 'tf2_monitor', 'tf_doctor',
                'tf_trajectory', 'view_frames', 'web_view')
        ],
    },
)
