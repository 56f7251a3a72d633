"""Rudder force, thesis (2.9)-(2.12); (2.9) corrected: see docs/errata.md. Angles in rad, speeds in m/s, forces in N."""

from __future__ import annotations

import math


def flow_squared(u_a: float, thrust_n: float, C_T: float) -> float:
    """Return v_av^2 = u_a^2 + C_T tau, thesis (2.10): the flow at a rudder behind a propeller, never below zero."""
    return max(0.0, u_a * u_a + C_T * thrust_n)


def attack_angle(delta: float, u: float, v: float, r: float, L: float) -> float:
    """Return delta_a = delta - atan((v + L r) / u): angle between rudder and flow. L: rudder to centre of mass, m."""
    if u == 0.0 and v + L * r == 0.0:
        return delta
    return delta - math.atan2(v + L * r, u)


def stall_end(delta_s: float) -> float:
    """Return the angle in rad at which the stalled rudder has become a flat plate: see `normal_part`."""
    return math.pi / (1.0 + math.pi / (2.0 * delta_s))


def normal_part(delta_a: float, delta_s: float) -> float:
    """Return the force over c_F v_av^2 at an angle of attack, with stall angle 0 < delta_s < pi/2; thesis (2.9).

    As printed it falls at delta_s from 1 to sin(delta_s) at once. Here the first law goes on falling beyond delta_s
    until it meets the second, sin(delta), and that holds from there: continuous, odd, and equal to both printed laws
    outside that gap (for 25 degrees it ends at 39).
    """
    size = abs(delta_a)
    part = math.sin(math.pi / 2.0 * size / delta_s) if size < stall_end(delta_s) else math.sin(size)
    return math.copysign(part, delta_a)


def force(delta_a: float, v_av_squared: float, c_F: float, delta_s: float) -> float:
    """Return the force normal to the rudder in N, thesis (2.9) made continuous and odd."""
    return c_F * v_av_squared * normal_part(delta_a, delta_s)


def angle(force_n: float, v_av_squared: float, c_F: float, delta_s: float) -> float:
    """Return the angle of attack, at most the stall angle, that gives a force in N or as much of it as there is."""
    most = c_F * v_av_squared
    if most <= 0.0:
        return 0.0
    return 2.0 * delta_s / math.pi * math.asin(max(-1.0, min(1.0, force_n / most)))


def linear_force(delta: float, n: float, U: float, k_r1: float, k_r2: float) -> float:
    """Return k_r1 U^2 delta + k_r2 n |n| delta, thesis (2.12): the force far below the stall angle."""
    return (k_r1 * U * U + k_r2 * n * abs(n)) * delta
