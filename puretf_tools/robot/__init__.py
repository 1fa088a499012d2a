"""
Robots that URDF describes: links, joints and shapes, without ROS.

The node that publishes their transforms is in `puretf_tools.robot.state_publisher`.
"""

from puretf_tools.robot.description import Description, Joint, Mimic, parse
from puretf_tools.robot.shapes import Shape
from puretf_tools.robot.urdf_text import DescriptionError, read

__all__ = ['Description', 'DescriptionError', 'Joint', 'Mimic', 'Shape', 'parse', 'read']
