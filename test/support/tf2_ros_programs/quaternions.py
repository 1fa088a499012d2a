"""Compute with quaternions, as in the tutorial about them; written for tf_transformations."""

import math

from geometry_msgs.msg import Quaternion
import tf_transformations

# Roll, pitch, yaw to a quaternion and back.
q = tf_transformations.quaternion_from_euler(1.5707, 0, -1.5707)
print(f'The quaternion representation is {q[0]:.4f} {q[1]:.4f} {q[2]:.4f} {q[3]:.4f}.')
msg = Quaternion(x=q[0], y=q[1], z=q[2], w=q[3])
roll, pitch, yaw = tf_transformations.euler_from_quaternion([msg.x, msg.y, msg.z, msg.w])
print(f'{roll:.4f} {abs(pitch):.4f} {yaw:.4f}')

# Rotate the previous pose by 180 degrees about x.
q_orig = tf_transformations.quaternion_from_euler(0, 0, 0)
q_rot = tf_transformations.quaternion_from_euler(math.pi, 0, 0)
q_new = tf_transformations.quaternion_multiply(q_rot, q_orig)
print(f'{q_new[0]:.1f} {q_new[1]:.1f} {q_new[2]:.1f} {abs(q_new[3]):.1f}')

# The relative rotation between two orientations.
q1_inv = tf_transformations.quaternion_inverse(q_rot)
qr = tf_transformations.quaternion_multiply(q_new, q1_inv)
print(f'{abs(qr[3]):.1f}')

# Negate w of an inverse in place, as many programs do.
q1_inv[3] = -q1_inv[3]
print(len(q1_inv))
