"""Where things are on a playground's page, for a mouse."""

from __future__ import annotations

import numpy as np

from stancekit.planners.files.arrays import Array
from stancekit.views.playground.serving import Page

from .chromium import Tab


def middle_of(tab: Tab, script: str) -> tuple[float, float]:
    """Where an element is on the page [px]."""
    box = tab.value(
        f"(() => {{const r = ({script}).getBoundingClientRect(); return [r.x, r.y, r.width, r.height]}})()"
    )
    return box[0] + 0.5 * box[2], box[1] + 0.5 * box[3]


def pixel_of(page: Page, tab: Tab, place_m: Array) -> tuple[float, float]:
    """Where a place is seen on the page [px]."""
    (client,) = page.playground.clients()
    eye, target = np.array(client.camera.position), np.array(client.camera.look_at)
    back = (eye - target) / np.linalg.norm(eye - target)
    right = np.cross([0.0, 0.0, 1.0], back)
    right /= np.linalg.norm(right)
    x, y, depth = np.stack([right, np.cross(back, right), -back]) @ (np.asarray(place_m) - eye)
    left, top, width, height = tab.value(
        "(() => {const r = document.querySelector('canvas').getBoundingClientRect();"
        " return [r.x, r.y, r.width, r.height]})()"
    )
    focal = 0.5 * height / np.tan(0.5 * client.camera.fov)
    return left + 0.5 * width + focal * x / depth, top + 0.5 * height - focal * y / depth
