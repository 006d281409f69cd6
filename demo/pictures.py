# SPDX-License-Identifier: MIT OR Apache-2.0
"""Rendered bodies with transparent surroundings become finished pictures."""

from __future__ import annotations

from pathlib import Path

from PIL import Image, ImageDraw, ImageFont

BACKGROUND = (235, 236, 238)
TEXT = (70, 74, 80)


def flatten(path: Path) -> None:
    """Put a rendered picture onto the background, in place."""
    with Image.open(path) as rendered:
        picture = Image.new("RGB", rendered.size, BACKGROUND)
        picture.paste(rendered, mask=rendered.getchannel("A"))
    picture.save(path, optimize=True)


def lay_over(path: Path, above: Path) -> None:
    """Put a rendered picture onto another of the same size, which stays transparent around both."""
    with Image.open(path) as below, Image.open(above) as top:
        picture = Image.alpha_composite(below.convert("RGBA"), top.convert("RGBA"))
    picture.save(path)


def contact_sheet(paths: list[Path], captions: list[str], target: Path, *, width: int = 340) -> None:
    """The pictures in one row with a caption below each."""
    font = ImageFont.load_default(size=15)
    pictures = []
    for path in paths:
        with Image.open(path) as picture:
            size = (width, round(picture.height * width / picture.width))
            pictures.append(picture.convert("RGB").resize(size, Image.Resampling.LANCZOS))
    sheet = Image.new("RGB", (width * len(pictures), pictures[0].height + 34), BACKGROUND)
    draw = ImageDraw.Draw(sheet)
    for column, (picture, caption) in enumerate(zip(pictures, captions, strict=True)):
        sheet.paste(picture, (column * width, 0))
        centre = (column * width + width // 2, sheet.height - 20)
        draw.text(centre, caption, fill=TEXT, font=font, anchor="mm")
    target.parent.mkdir(parents=True, exist_ok=True)
    sheet.save(target, optimize=True)


def stack(paths: list[Path], target: Path) -> None:
    """Pictures of one width below each other."""
    rows = []
    for path in paths:
        with Image.open(path) as picture:
            rows.append(picture.convert("RGB"))
    sheet = Image.new("RGB", (rows[0].width, sum(row.height for row in rows)), BACKGROUND)
    top = 0
    for row in rows:
        sheet.paste(row, (0, top))
        top += row.height
    target.parent.mkdir(parents=True, exist_ok=True)
    sheet.save(target, optimize=True)
