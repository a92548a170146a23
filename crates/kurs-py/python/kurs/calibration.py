"""Accelerometers and gyros at rest: bias, scale, misalignment, noise; sensor axes, m/s² and rad/s."""

from kurs._native import allan_deviation, gyro_bias, multi_pose, rests, six_position

__all__ = ["allan_deviation", "gyro_bias", "multi_pose", "rests", "six_position"]
