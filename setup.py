import os
from pathlib import Path
import re

from setuptools import find_packages, setup
from setuptools.command.build_py import build_py

package_name = 'dummy_arm'
home = 'https://github.com/dummy-arm/dummy_arm'
# On PyPI, pictures and links need the whole address.
readme = (Path(__file__).resolve().parent / 'README.md').read_text(encoding='utf-8')
readme = re.sub(r'(!\[[^]]*\]\()(?!http)', rf'\1{home}/raw/main/', readme)
readme = re.sub(r'(\]\()(?!http|#)', rf'\1{home}/blob/main/', readme)
#: What the tools need of every ROS 2 from pip.
beside_ros = ['psutil>=5.9', 'pygraphviz', 'pypdf', 'pyyaml', 'tqdm']
install = """
This command installs the package from PyPI, with ROS 2, the web page, the reader of bags, and the
import names of tf2 (Linux x86-64; elsewhere, leave out `ros` and `dummy-arm-tf2`):

    pip install 'dummy-arm[ros,view,bag]' dummy-arm-tf2

All that follows is about a clone of the repository.
"""


class BuildWithPage(build_py):
    """Install the page that `tf_doctor --explain` prints; a checkout has it in docs/."""

    def finalize_options(self):
        super().finalize_options()
        self.data_files.append(('puretf_tools.doctor', 'docs', os.path.join(
            self.build_lib, 'puretf_tools', 'doctor'), ['troubleshooting.md']))


setup(
    name=package_name,
    version='0.4.0',
    cmdclass={'build_py': BuildWithPage},
    packages=find_packages(include=[package_name, f'{package_name}.*', 'puretf', 'puretf.*',
                                    'puretf_tools', 'puretf_tools.*']),
    package_data={'': ['py.typed'], package_name: ['urdf/*.urdf'],
                  'puretf_tools.view': ['*.css', '*.html', '*.js']},
    data_files=[
        ('share/ament_index/resource_index/packages', [f'resource/{package_name}']),
        (f'share/{package_name}', ['package.xml']),
        (f'share/{package_name}/launch', ['launch/dummy_arm.launch.py']),
        (f'share/{package_name}/rviz', ['rviz/dummy_arm.rviz']),
        (f'share/{package_name}/urdf', ['dummy_arm/urdf/dummy_arm.urdf']),
    ],
    python_requires='>=3.10',
    install_requires=['numpy>=1.26', 'transforms3d>=0.4'],
    extras_require={
        # Upper bounds: the package uses private parts of rclpy and viser, see
        # test_private_apis.py; rosbags has no stable version yet.
        'ros': ['ros-jazzy-common-interfaces>=5.3,<6', 'ros-jazzy-rclpy[fastrtps]>=7.1,<7.2',
                *beside_ros],
        'ros-kilted': ['ros-kilted-common-interfaces>=5.5,<6',
                       'ros-kilted-rclpy[fastrtps]>=9.1,<9.2', *beside_ros],
        'robot': ['xacro'],
        'view': ['viser>=1.1.1,<1.2', 'pycollada', 'trimesh>=4.6', 'websockets<17'],
        'bag': ['backports.zstd; python_version < "3.14"', 'lz4', 'matplotlib', 'mcap>=1.2.1,<2',
                'pygraphviz', 'pypdf', 'rosbags>=0.11.7,<0.12', 'ruamel.yaml', 'tqdm'],
        'bench': ['matplotlib', 'transform-tree==0.0.9; sys_platform == "linux"'],
        'dask': ['distributed', 'fsspec'],
        'docs': ['furo', 'myst-parser>=4,<5', 'sphinx>=8.2,<8.3'],
        'fuzz': ['atheris>=3,<4; sys_platform == "linux" and python_version >= "3.11"'],
        'pictures': ['matplotlib', 'pillow', 'pypdfium2'],
        'release': ['build', 'twine'],
        'test': ['axe-playwright-python', 'check-jsonschema', 'colcon-common-extensions',
                 'hypothesis', 'mypy', 'playwright', 'pypdf', 'pytest', 'pytest-xdist',
                 'ruff', 'types-psutil', 'wheel', 'zizmor'],
    },
    zip_safe=True,
    maintainer='dummy_arm developers',
    maintainer_email='dummy-arm@example.org',
    description='A small arm that waves, published as TF, and TF itself in pure Python.',
    long_description=readme.replace('\n## Start\n', f'{install}\n## Start\n'),
    long_description_content_type='text/markdown',
    license='MIT',
    url=home,
    project_urls={
        'Documentation': f'{home}/tree/main/docs',
        'Changelog': f'{home}/blob/main/CHANGELOG.rst',
        'Issues': f'{home}/issues',
        'Source': home,
    },
    keywords=['ROS', 'ROS 2', 'robotics', 'tf', 'tf2', 'transforms', 'coordinate frames',
              'quaternions', 'rosbag'],
    classifiers=[
        'Development Status :: 4 - Beta',
        'Intended Audience :: Developers',
        'Intended Audience :: Education',
        'Intended Audience :: Science/Research',
        'Operating System :: MacOS',
        'Operating System :: Microsoft :: Windows',
        'Operating System :: POSIX :: Linux',
        'Programming Language :: Python :: 3',
        *(f'Programming Language :: Python :: 3.{minor}' for minor in range(10, 14)),
        'Topic :: Education',
        'Topic :: Scientific/Engineering',
        'Typing :: Typed',
    ],
    entry_points={
        'console_scripts': [
            f'{command} = {package}.entry_points:{command}' for package, commands in {
                'dummy_arm': ('check_arm', 'dummy_arm', 'dynamic_tf_publisher'),
                'puretf_tools': (
                    'joint_state_publisher', 'param', 'robot_state_publisher',
                    'static_transform_publisher', 'tf2_echo', 'tf2_monitor', 'tf_doctor',
                    'tf_trajectory', 'view_frames', 'web_view'),
            }.items() for command in commands
        ],
    },
)
