"""A printed sheet as PDF with true size: black squares, a ruler to check the printer, a line of text."""

from __future__ import annotations

from collections.abc import Sequence

PAPERS_MM = {"a4": (210.0, 297.0), "a3": (297.0, 420.0), "a2": (420.0, 594.0), "letter": (215.9, 279.4)}
_PT_PER_MM = 72.0 / 25.4
_MARGIN_MM = 8.0
_FOOT_MM = 10.0
"""Below the drawing: ruler and text."""

Square = tuple[float, float, float]
"""x, y of the upper left corner, side."""


def sheet_pdf(squares: Sequence[Square], size: tuple[float, float], text: str, paper: str, ruler_mm: float) -> bytes:
    """Return a PDF of one page with a drawing in its middle, upright or across as it fits.

    squares and size (width, height): in m, from the drawing's upper left. Raises ValueError when the drawing does not
    fit the paper, or the paper is not known.
    """
    if paper not in PAPERS_MM:
        raise ValueError(f"no paper {paper}; known: {', '.join(PAPERS_MM)}")
    width, height = (1e3 * v for v in size)
    upright = PAPERS_MM[paper]
    pages = [p for p in (upright, upright[::-1]) if _fits(width, height, p)]
    if not pages:
        raise ValueError(
            f"{width:.0f} mm x {height:.0f} mm do not fit {paper} ({upright[0]:.0f} mm x {upright[1]:.0f} mm) with its"
            f" margins of {_MARGIN_MM:.0f} mm and {_FOOT_MM:.0f} mm of text: make it smaller, or take another paper"
        )
    page = pages[0]
    left, top = 0.5 * (page[0] - width), 0.5 * (page[1] - _FOOT_MM - height)

    def rectangle(x: float, y: float, w: float, h: float) -> str:
        return " ".join(f"{v * _PT_PER_MM:.4f}" for v in (x, page[1] - y - h, w, h)) + " re"

    drawing = [rectangle(left + 1e3 * x, top + 1e3 * y, 1e3 * side, 1e3 * side) for x, y, side in squares]
    ruler_y = page[1] - _MARGIN_MM - 1.0
    start = max(left, _MARGIN_MM)
    ruler = [
        rectangle(start, ruler_y, ruler_mm, 0.3),
        rectangle(start, ruler_y - 2.0, 0.3, 2.0),
        rectangle(start + ruler_mm - 0.3, ruler_y - 2.0, 0.3, 2.0),
    ]
    at = f"{start * _PT_PER_MM:.2f} {(page[1] - ruler_y + 3.0) * _PT_PER_MM:.2f}"
    words = text.replace("\\", r"\\").replace("(", r"\(").replace(")", r"\)")
    # One path, filled at once: neighbouring squares show no seams.
    content = "\n".join(["0 g", *drawing, *ruler, "f", f"BT /F 7 Tf {at} Td ({words}) Tj ET"])
    return _document(content.encode("latin-1"), page)


def _fits(width: float, height: float, page: tuple[float, float]) -> bool:
    return width + 2 * _MARGIN_MM <= page[0] and height + _FOOT_MM + 2 * _MARGIN_MM <= page[1]


def _document(content: bytes, page_mm: tuple[float, float]) -> bytes:
    box = " ".join(f"{v * _PT_PER_MM:.4f}" for v in page_mm)
    objects = [
        b"<< /Type /Catalog /Pages 2 0 R /ViewerPreferences << /PrintScaling /None >> >>",
        b"<< /Type /Pages /Kids [3 0 R] /Count 1 >>",
        f"<< /Type /Page /Parent 2 0 R /MediaBox [0 0 {box}] /Contents 4 0 R".encode()
        + b" /Resources << /Font << /F << /Type /Font /Subtype /Type1 /BaseFont /Helvetica >> >> >> >>",
        b"<< /Length %d >>\nstream\n" % len(content) + content + b"\nendstream",
    ]
    document = b"%PDF-1.4\n"
    places = []
    for number, body in enumerate(objects, 1):
        places.append(len(document))
        document += b"%d 0 obj\n" % number + body + b"\nendobj\n"
    start = len(document)
    table = b"".join(b"%010d 00000 n \n" % place for place in places)
    document += b"xref\n0 %d\n0000000000 65535 f \n" % (len(objects) + 1) + table
    return document + b"trailer\n<< /Size %d /Root 1 0 R >>\nstartxref\n%d\n%%%%EOF\n" % (len(objects) + 1, start)
