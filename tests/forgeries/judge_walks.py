"""A judge of walks: what no robot could do, by numpy and the file's own arrays alone.

Its numbers are its own, of what the verifier refuses and half as much again; it shares no code with
it.
"""

from __future__ import annotations

from typing import Any

import numpy as np

G = 9.81


def runs(flags: Any) -> list[tuple[int, int]]:
    """First and last sample of every run of true values that has an end on both sides."""
    padded = np.concatenate([[flags[0]], flags, [flags[-1]]]).astype(int)
    edges = np.flatnonzero(np.diff(padded))
    begins = [edge for edge in edges if flags[min(edge, len(flags) - 1)]]
    return [(b, e - 1) for b in begins for e in edges[edges > b][:1]]


def inexecutable(walk: Any) -> str:
    """Why no robot does it; empty where the judge does not know."""
    for why in (_body, _feet, _swings, _ends, _balance, _cones):
        reason = why(walk)
        if reason:
            return reason
    return ""


def _body(w: Any) -> str:
    product = np.einsum("kij,kil->kjl", w.rotation, w.rotation)
    if abs(product - np.eye(3)).max() > 1.5e-6 or (np.linalg.det(w.rotation) < 0).any():
        return "its body is no rigid one"
    points = np.concatenate([w.feet_m.reshape(-1, 3), w.torso_m])[:, :2]
    low, high = (
        np.array([w.problem.terrain.x_m[0], w.problem.terrain.y_m[0]]),
        np.array([w.problem.terrain.x_m[-1], w.problem.terrain.y_m[-1]]),
    )
    if (points < low - 1e-4).any() or (points > high + 1e-4).any():
        return "it leaves the map"
    local = np.einsum("kji,kej->kei", w.rotation, w.feet_m - w.torso_m[:, None])
    for number, foot in enumerate(w.robot.feet):
        off = np.maximum(
            foot.reach_min_m - local[:, number], local[:, number] - foot.reach_max_m
        ).max()
        if off > 4.5e-3:
            return "a leg is too short or too long"
    half = w.robot.trunk_half_m
    x, y = np.meshgrid(np.linspace(-half[0], half[0], 109), np.linspace(-half[1], half[1], 53))
    below = np.stack([x.ravel(), y.ravel(), np.full(x.size, -half[2])], axis=1)
    for k in range(0, len(w.torso_m), 40):
        face = w.torso_m[k] + below @ w.rotation[k].T
        if (w.problem.terrain.height(face[:, :2]) - face[:, 2]).max() > 1e-3:
            return "its trunk is in the ground"
    return ""


def _feet(w: Any) -> str:
    dt = w.times_s[1] - w.times_s[0]
    step = np.linalg.norm(np.diff(w.feet_m, axis=0), axis=2)
    if (step / dt > 15.0).any() or (
        np.linalg.norm(np.diff(w.feet_m, 2, axis=0), axis=2) > 7.5e-3
    ).any():
        return "a foot jumps"
    ground = w.problem.terrain.height(w.feet_m[..., :2])
    if (abs(w.feet_m[..., 2] - ground)[w.contact] > 1.5e-3).any():
        return "a foot stands where no ground is"
    if (np.linalg.norm(w.forces_n, axis=2)[~w.contact] > 1.5e-3 * w.robot.mass_kg * G).any():
        return "a foot presses on air"
    if (step[w.contact[1:] & w.contact[:-1]] / dt > 0.015).any():
        return "a foot slides while it carries"
    for e in range(w.contact.shape[1]):
        edges = np.flatnonzero(np.diff(np.concatenate([[0], w.contact[:, e].astype(int), [0]])))
        for first, end in edges.reshape(-1, 2):
            if np.linalg.norm(w.feet_m[first:end, e] - w.feet_m[first, e], axis=1).max() > 1.5e-3:
                return "a foot slides as it stands"
    return ""


def _swings(w: Any) -> str:
    dt = w.times_s[1] - w.times_s[0]
    height = w.feet_m[..., 2] - w.problem.terrain.height(w.feet_m[..., :2])
    for e in range(w.contact.shape[1]):
        for first, last in runs(w.contact[:, e]):
            if (last - first + 1) * dt < 0.095:
                return "a foot stands for no time at all"
        for first, last in runs(~w.contact[:, e]):
            high, count = height[first : last + 1, e], last - first + 1
            if (count + 1) * dt < 0.095:
                return "a foot swings for no time at all"
            if (
                high.max() < 4.5e-3
                or high.min() < -1.4e-3
                or high[count // 4 : count - count // 4].min() < 9e-4
            ):
                return "a foot swings along or through the ground"
    return ""


def _ends(w: Any) -> str:
    if (
        np.hypot(*(w.torso_m[0, :2] - w.problem.start)) > 7e-3
        or np.hypot(*(w.torso_m[-1, :2] - w.problem.goal)) > 7e-3
    ):
        return "it goes from or to another place"
    dt = w.times_s[1] - w.times_s[0]
    speed = np.linalg.norm(np.diff(w.torso_m, axis=0), axis=1) / dt
    if (w.problem.still[0] and speed[0] > 7e-3) or (w.problem.still[1] and speed[-1] > 7e-3):
        return "it is not at rest where it should be"
    x = w.rotation[0, :, 0]
    if (
        w.problem.heading_rad is not None
        and abs(np.sin(np.arctan2(x[1], x[0]) - w.problem.heading_rad)) > 0.013
    ):
        return "it faces elsewhere"
    return ""


def _balance(w: Any) -> str:
    """Momentum and angular momentum from the file's motion against the impulses of its forces,
    window by window.
    """
    dt, weight = w.times_s[1] - w.times_s[0], w.robot.mass_kg * G
    speed = np.diff(w.torso_m, axis=0) / dt
    gained = w.robot.mass_kg * (speed[1:] - speed[:1])
    pressed = np.cumsum(w.forces_n[1:-1].sum(axis=1), axis=0) * dt
    pressed[:, 2] -= weight * dt * np.arange(1, len(pressed) + 1)
    lacks = np.concatenate([np.zeros((1, 3)), gained - pressed])
    arms = np.cross(w.feet_m - w.torso_m[:, None], w.forces_n).sum(axis=1)
    turning = np.einsum("kji,kjl->kil", w.rotation[:-1], w.rotation[1:])
    rate = (
        0.5
        / dt
        * np.stack(
            [
                turning[:, 2, 1] - turning[:, 1, 2],
                turning[:, 0, 2] - turning[:, 2, 0],
                turning[:, 1, 0] - turning[:, 0, 1],
            ],
            axis=1,
        )
    )
    spin = np.einsum("kij,jl,kl->ki", w.rotation[:-1], w.robot.inertia_kgm2, rate)
    turns = np.concatenate(
        [np.zeros((1, 3)), spin[1:] - spin[:1] - np.cumsum(arms[1:-1], axis=0) * dt]
    )
    moment = weight * w.robot.stand_height_m
    for apart in (1, 2, 4, 8, 16, 24, 40, 80, 160, 320, 640, len(lacks) - 1):
        if apart >= len(lacks):
            break
        lasts = apart * dt
        short = np.linalg.norm(lacks[apart:] - lacks[:-apart], axis=1).max()
        if short > weight * min(0.6 * lasts, 0.013 + 0.02 * lasts):
            return "its feet do not give the impulse that it takes"
        short = np.linalg.norm(turns[apart:] - turns[:-apart], axis=1).max()
        if short > moment * min(0.45 * lasts, 0.02 + 2.7e-3 * lasts):
            return "its feet do not turn it as it turns"
    return ""


def _cones(w: Any) -> str:
    weight, sucks = (
        w.robot.mass_kg * G,
        np.where(w.problem.adhesive, w.problem.suction_n or 0.0, 0.0),
    )
    small = 1e-4
    at = w.feet_m[..., :2]
    slope = [
        (w.problem.terrain.height(at + one) - w.problem.terrain.height(at - one)) / (2 * small)
        for one in small * np.eye(2)
    ]
    up = np.stack([-slope[0], -slope[1], np.ones_like(slope[0])], axis=2)
    up /= np.linalg.norm(up, axis=2, keepdims=True)
    normal = (w.forces_n * up).sum(axis=2)
    flat = np.linalg.norm(w.forces_n - normal[..., None] * up, axis=2)
    outside = np.maximum(flat - w.problem.friction * (normal + sucks), -(normal + sucks))
    if (np.where(w.contact, outside, 0.0) > 1.3e-3 * weight).any():
        return "a foot presses or pulls as its ground does not let it"
    if (np.linalg.norm(w.forces_n, axis=2) > 3.0 * weight).any():
        return "a leg presses with more than three times the weight"
    if not w.problem.adhesive.any() and np.ptp(w.problem.terrain.heights_m) < 1e-9:
        need = w.robot.mass_kg * np.diff(w.torso_m, 2, axis=0) / (w.times_s[1] - w.times_s[0]) ** 2
        beyond = np.maximum(
            np.linalg.norm(need[:, :2], axis=1) - w.problem.friction * (need[:, 2] + weight), 0.0
        )
        if beyond.sum() * (w.times_s[1] - w.times_s[0]) > 3e-3 * weight:
            return "level ground of this friction does not push it as it goes"
    return ""
