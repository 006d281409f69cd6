"""The chart of `bench/performance.py`: every figure as a share of its bound, and how a frame grows."""

import numpy as np
from PIL import Image, ImageDraw

BACKGROUND, INK, GRID = (247, 247, 245), (40, 40, 40), (215, 215, 212)
MET, MISSED = (20, 105, 190), (190, 60, 60)
CURVES = {"body": (20, 105, 190), "generated": (220, 120, 20)}
WIDTH, LINE, MARGIN, LEFT = 1000, 22, 24, 330
PLOT = 320


def draw(report, path):
    """Write the picture."""
    rows = report["figures"]
    image = Image.new("RGB", (WIDTH, 2 * MARGIN + LINE * (len(rows) + 3) + PLOT + 3 * MARGIN), BACKGROUND)
    canvas = ImageDraw.Draw(image)
    canvas.text((MARGIN, MARGIN), f"Share of the bound, up to 1 is met. {report['machine']}", fill=INK)
    place = lambda share: LEFT + (WIDTH - LEFT - 6 * MARGIN) * min(max(share, 0.0), 2.0) / 2.0  # noqa: E731
    top, bottom = 2 * MARGIN, 2 * MARGIN + LINE * len(rows)
    for tick in (0.0, 0.5, 1.0, 1.5, 2.0):
        canvas.line([place(tick), top, place(tick), bottom], fill=INK if tick == 1.0 else GRID)
        canvas.text((place(tick) - 8, bottom + 4), f"{tick:.1f}", fill=INK)
    for at, row in enumerate(rows):
        y = top + LINE * at
        share = row["bound"] / row["value"] if "at least" in row["unit"] else row["value"] / row["bound"]
        canvas.text((MARGIN, y + 5), row["name"], fill=INK)
        canvas.rectangle([place(0.0), y + 4, place(share), y + LINE - 4], fill=MET if row["met"] else MISSED)
        canvas.text((place(share) + 6, y + 5), f"{row['value']:.2f} of {row['bound']:g}", fill=INK)
    growth(canvas, report["enabling"], bottom + 3 * MARGIN)
    image.save(path)


def growth(canvas, rows, top):
    """Processor time of a frame for each moved joint over the number of vertices, both logarithmic."""
    canvas.text((MARGIN, top), "Processor time of a frame for each moved joint, microseconds, by vertices", fill=INK)
    top += LINE
    sizes = np.array([row["vertices"] for row in rows], float)
    times = np.array([row["processor_us_per_joint"] for row in rows], float)
    low = np.floor(np.log10([sizes.min(), times.min()]))
    high = np.ceil(np.log10([sizes.max(), times.max()]))
    x = lambda size: 3 * MARGIN + (WIDTH - 5 * MARGIN) * (np.log10(size) - low[0]) / (high[0] - low[0])  # noqa: E731
    y = lambda time: top + PLOT * (high[1] - np.log10(time)) / (high[1] - low[1])  # noqa: E731
    for tick in 10.0 ** np.arange(low[0], high[0] + 1):
        canvas.line([x(tick), top, x(tick), top + PLOT], fill=GRID)
        canvas.text((x(tick) - 12, top + PLOT + 4), f"{tick:,.0f}", fill=INK)
    for tick in 10.0 ** np.arange(low[1], high[1] + 1):
        canvas.line([x(10 ** low[0]), y(tick), x(10 ** high[0]), y(tick)], fill=GRID)
        canvas.text((MARGIN, y(tick) - 6), f"{tick:,.0f}", fill=INK)
    for at, (kind, colour) in enumerate(CURVES.items()):
        points = sorted((row["vertices"], row["processor_us_per_joint"]) for row in rows if row["kind"] == kind)
        places = [(x(size), y(time)) for size, time in points]
        if len(places) > 1:
            canvas.line(places, fill=colour, width=2)
        for px, py in places:
            canvas.ellipse([px - 4, py - 4, px + 4, py + 4], fill=colour)
        canvas.text((4 * MARGIN, top + 8 + LINE * at), kind, fill=colour)
