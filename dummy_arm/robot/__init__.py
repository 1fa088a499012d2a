"""Robots that are described by URDF."""
