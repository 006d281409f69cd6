"""What all pairs of `bench/retarget.py` come to: means for each method, and a picture of the errors."""

import numpy as np
from PIL import Image, ImageDraw

COLOURS = {
    "auto": (20, 105, 190),
    "closest point": (220, 120, 20),
    "inpainting": (190, 60, 60),
    "paper": (120, 120, 120),
    "eq. 2": (150, 190, 60),
    "volumetric": (40, 150, 90),
    "bone heat": (150, 90, 180),
}
LINE, LEFT, WIDTH, MARGIN = 17, 130, 620, 24
BACKGROUND, INK, GRID = (247, 247, 245), (40, 40, 40), (215, 215, 212)


def summary(results, methods):
    """For each method the means over the pairs it was measured on, and against how many of them it is best."""
    found = {}
    for method in methods:
        rows = {name: pair["methods"].get(method, {}) for name, pair in results.items()}
        rows = {name: row for name, row in rows.items() if "l1" in row}
        if rows:
            best = sum(row["l1"] <= least(results[name]) for name, row in rows.items())
            found[method] = {"pairs": len(rows), "best": best} | {
                key: round(float(np.mean([row[key] for row in rows.values()])), 5)
                for key in ("l1", "pose_error", "seconds", "megabytes")
            }
    return found


def least(pair):
    """The smallest error of any method on a pair."""
    return min(row["l1"] for row in pair["methods"].values() if "l1" in row)


def table(found):
    """The summary as text."""
    lines = ["all pairs: method, pairs, of them best, mean L1, mean pose error, mean seconds, mean peak memory"]
    for method, row in found.items():
        lines.append(
            f"  {method:<14} {row['pairs']:4d} {row['best']:4d} {row['l1']:7.3f} {100 * row['pose_error']:9.3f} %"
            f" {row['seconds']:8.2f} s {row['megabytes']:7.0f} MB"
        )
    return "\n".join(lines)


def draw(results, methods, path):
    """Writes a picture: a line for each pair, a dot for each method at its mean L1 error, 0 to 2."""
    height = LINE * len(results) + 3 * MARGIN
    image = Image.new("RGB", (LEFT + WIDTH + 2 * MARGIN, height), BACKGROUND)
    canvas = ImageDraw.Draw(image)
    place = lambda error: LEFT + MARGIN + WIDTH * min(error, 2.0) / 2.0  # noqa: E731
    bottom = height - MARGIN
    for tick in np.arange(0.0, 2.01, 0.25):
        canvas.line([place(tick), 2 * MARGIN - 6, place(tick), bottom], fill=GRID)
        canvas.text((place(tick) - 8, bottom + 4), f"{tick:.2f}", fill=INK)
    for at, method in enumerate(methods):
        x = MARGIN + at * (LEFT + WIDTH) / len(methods)
        dot(canvas, x, MARGIN, COLOURS.get(method, INK))
        canvas.text((x + 8, MARGIN - 6), method, fill=INK)
    for at, (name, pair) in enumerate(results.items()):
        y = 2 * MARGIN + LINE * at + LINE / 2
        canvas.text((MARGIN, y - 6), name, fill=INK)
        canvas.line([place(0.0), y, place(2.0), y], fill=GRID)
        # Our own dot comes last, on top of the others.
        for method in reversed(methods):
            row = pair["methods"].get(method, {})
            if "l1" in row:
                dot(canvas, place(row["l1"]), y, COLOURS.get(method, INK))
    image.save(path)


def dot(canvas, x, y, colour, radius=4):
    """A filled circle."""
    canvas.ellipse([x - radius, y - radius, x + radius, y + radius], fill=colour)
