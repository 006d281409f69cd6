"""Pictures of skin weights: flat-shaded surfaces, one colour for each bone, drawn back to front."""

import colorsys

import numpy as np
from PIL import Image, ImageDraw

GOLDEN_RATIO = 0.618033988749895
LIGHT = np.array([-0.35, -0.8, 0.5]) / np.linalg.norm([-0.35, -0.8, 0.5])
SIZE, MARGIN, CAPTION = (360, 460), 16, 22
BACKGROUND = (247, 247, 245)


def bone_colours(count):
    """(count,3) colours; those of neighbouring numbers lie far apart."""
    hues = (np.arange(count) * GOLDEN_RATIO) % 1.0
    return np.array([colorsys.hsv_to_rgb(hue, 0.75, (0.95, 0.6, 0.78)[i % 3]) for i, hue in enumerate(hues)])


def draw(vertices, triangles, weights, turn=30.0):
    """An image of a surface (V,3), (F,3) with weights (V,B), seen from the front and turned by some degrees."""
    angle = np.radians(turn)
    rotation = np.array([[np.cos(angle), -np.sin(angle), 0], [np.sin(angle), np.cos(angle), 0], [0, 0, 1]])
    points = vertices @ rotation.T
    low, high = points.min(axis=0), points.max(axis=0)
    scale = min((SIZE[0] - 2 * MARGIN) / (high - low)[0], (SIZE[1] - 2 * MARGIN) / (high - low)[2])
    flat = np.stack([points[:, 0] - 0.5 * (low + high)[0], -(points[:, 2] - 0.5 * (low + high)[2])], axis=1)
    flat = flat * scale + np.array(SIZE) / 2
    corners = points[triangles]
    normals = np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0])
    normals /= np.maximum(np.linalg.norm(normals, axis=1, keepdims=True), 1e-300)
    facing = normals[:, 1] < 0
    shade = 0.45 + 0.55 * np.clip(normals @ LIGHT, 0.0, 1.0)
    colours = (weights @ bone_colours(weights.shape[1]))[triangles].mean(axis=1) * shade[:, None]
    colours = (255 * np.clip(colours, 0.0, 1.0)).astype(int)
    image = Image.new("RGB", SIZE, BACKGROUND)
    canvas = ImageDraw.Draw(image)
    # The camera looks along +y: what has the largest y is farthest.
    for face in np.argsort(-corners[:, :, 1].mean(axis=1), kind="stable"):
        if facing[face]:
            canvas.polygon([tuple(flat[v]) for v in triangles[face]], fill=tuple(colours[face]))
    return image


def sheet(images, path):
    """Writes images, a caption for each, side by side."""
    whole = Image.new("RGB", (SIZE[0] * len(images), SIZE[1] + CAPTION), BACKGROUND)
    canvas = ImageDraw.Draw(whole)
    for at, (caption, image) in enumerate(images.items()):
        whole.paste(image, (at * SIZE[0], CAPTION))
        canvas.text((at * SIZE[0] + MARGIN, 6), caption, fill=(40, 40, 40))
    whole.save(path)
