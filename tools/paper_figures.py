# SPDX-FileCopyrightText: The ruledgraph developers
# SPDX-License-Identifier: BSD-3-Clause
"""What tables 1 to 5 of the paper print (arXiv 2512.00327), and what is simulated for each line."""

from collections.abc import Iterator
from dataclasses import dataclass

TITLES = {
    1: "rotation-less motion",
    2: "motion with rotation",
    3: "non-smooth motion",
    4: "non-coplanar scene",
    5: "free motion",
}


@dataclass(frozen=True)
class Row:
    """A line of a table: what is simulated for it, and what the paper prints."""

    table: int
    name: str
    scene: str
    motion: str
    printed: tuple[float, ...]
    """Mean and deviation of X, Y, Z, and in table 5 of two lines' distances, m."""
    first_seed: int = 0
    """Of free motion, which is another one for every seed."""


def _row(table: int, name: str, scene: str, motion: str, printed: str, seed: int = 0) -> Row:
    return Row(table, name, scene, motion, tuple(map(float, printed.split())), seed)


_KINDS = ("parallel", "perpendicular", "parallel", "perpendicular", "tilted")
_TABLE_1 = """
0.0019 0.0080 0.0138 0.0215 0.0251 0.0173
0.0251 0.0159 0.0341 0.0270 0.0554 0.1004
0.0097 0.0197 0.0320 0.0230 0.0159 0.0211
0.0228 0.0258 0.0317 0.0384 0.1201 0.0800
0.1038 0.0808 0.0163 0.0236 0.1049 0.0665
"""
_TABLE_2 = """
0.0278 0.0289 0.0171 0.0369 0.0041 0.0086
0.0510 0.0446 0.0223 0.0170 0.0874 0.0607
0.0035 0.0115 0.0452 0.0240 0.0222 0.0104
0.0130 0.0260 0.0310 0.0144 0.0461 0.0421
0.0211 0.0305 0.0395 0.0230 0.0427 0.0268
0.0064 0.0117 0.0164 0.0130 0.0313 0.0306
0.0163 0.0156 0.0438 0.0252 0.0229 0.0189
0.0052 0.0204 0.0285 0.0247 0.0381 0.0255
0.0005 0.0254 0.0195 0.0182 0.0270 0.0164
0.0012 0.0174 0.0222 0.0249 0.0002 0.0141
0.0207 0.0250 0.0510 0.0286 0.0098 0.0211
0.0528 0.0286 0.0283 0.0187 0.0616 0.0431
0.0068 0.0202 0.0933 0.0552 0.1125 0.0846
0.0836 0.0672 0.0039 0.0102 0.0272 0.0182
0.0856 0.0510 0.0103 0.0136 0.0957 0.0439
"""
_TABLE_3 = """
0.0081 0.0071 0.0504 0.0267 0.0317 0.0319
0.0241 0.0206 0.0204 0.0202 0.0957 0.0558
0.0255 0.0221 0.0259 0.0266 0.0631 0.0362
0.0850 0.0478 0.0138 0.0182 0.0626 0.0427
0.0096 0.0217 0.0126 0.0077 0.0449 0.0549
"""


def _rows() -> Iterator[Row]:
    forms = ("linear", "linear", "circular", "circular", "circular")
    motions = [f"{form}-{kind}" for form, kind in zip(forms, _KINDS, strict=True)]
    for motion, printed in zip(motions, _TABLE_1.strip().splitlines(), strict=True):
        yield _row(1, motion.replace("-", " "), "square", motion, printed)
    turned = [(motion, axis) for motion in motions for axis in "xyz"]
    for (motion, axis), printed in zip(turned, _TABLE_2.strip().splitlines(), strict=True):
        name = f"{motion.replace('-', ' ')}, rotation {axis.upper()}"
        yield _row(2, name, "square", f"{motion}-rot-{axis}", printed)
    sharp = [f"zigzag-{kind}" for kind in ("parallel", "perpendicular", "tilted")]
    sharp += [f"square-{kind}" for kind in ("parallel", "perpendicular")]
    for motion, printed in zip(sharp, _TABLE_3.strip().splitlines(), strict=True):
        name = motion.replace("zigzag", "linear").replace("-", " ")
        yield _row(3, name, "square", motion, printed)
    circular = "circular-tilted"
    for name, motion, printed in (
        ("circular", circular, "0.0347 0.0404 0.0189 0.0387 0.2237 0.1428"),
        (
            "circular with rotation",
            f"{circular}-rot-y",
            "0.0410 0.0531 0.0423 0.0578 0.0373 0.0543",
        ),
    ):
        yield _row(4, name, "noncoplanar", motion, printed)
    for name, scene, seed, axes, lines in (
        (
            *("coplanar 1", "square", 1),
            "0.0236 0.0147 0.0257 0.0084 0.0207 0.0140",
            "0.0597 0.0290 0.0591 0.0339",
        ),
        (
            *("coplanar 2", "square", 2),
            "0.0139 0.0492 0.0519 0.0785 0.0600 0.0749",
            "0.2111 0.1940 0.2061 0.1412",
        ),
        (
            *("non-coplanar 1", "noncoplanar", 1),
            "0.0821 0.0642 0.0181 0.0919 0.1968 0.1301",
            "0.3713 0.2017 0.3885 0.2390",
        ),
        (
            *("non-coplanar 2", "noncoplanar", 2),
            "0.2441 0.1387 0.0169 0.0182 0.1739 0.0614",
            "0.3935 0.1586 0.3419 0.1990",
        ),
    ):
        yield _row(5, name, scene, "free", f"{axes} {lines}", seed)


ROWS = tuple(_rows())
