"""Which texts of the page are cut off, at the widths of a desk, tablets and a phone."""

from __future__ import annotations

from playwright.sync_api import Page, ViewportSize

SIZES: tuple[ViewportSize, ...] = (
    {"width": 1440, "height": 900},
    {"width": 1280, "height": 800},
    {"width": 1024, "height": 768},
    {"width": 820, "height": 1180},
    {"width": 390, "height": 844},
)
_ARROW_PX = 20

_CUT = """arrow => {
  const cut = [];
  const shown = [...document.querySelectorAll("body *")].filter((element) => element.checkVisibility());
  const hasText = ({ childNodes }) => [...childNodes].some((node) => node instanceof Text && node.data.trim());
  for (const element of shown.filter((one) => one.tagName !== "OPTION" && hasText(one))) {
    const range = document.createRange();
    range.selectNodeContents(element);
    let rect = range.getBoundingClientRect();
    for (let box = element; rect.width && box; box = box.parentElement) {
      const style = getComputedStyle(box), outer = box.getBoundingClientRect();
      if (["inline", "contents"].includes(style.display)) continue;
      if (/auto|scroll/.test(style.overflowX) || style.textOverflow === "ellipsis") rect = outer;
      const over = Math.max(rect.right - outer.right, outer.left - rect.left);
      if (over <= 0.5) continue;
      cut.push(`"${element.textContent.trim()}": ${over.toFixed(1)} px outside ${box.tagName} #${box.id}`);
      break;
    }
  }
  for (const box of shown.filter((one) => one.matches("input, th, button, .tab, .panel, main, header, [role=tablist]")))
    if (box.scrollWidth > box.clientWidth + 1)
      cut.push(`${box.tagName} #${box.id} ${box.name ?? ""}: ${box.scrollWidth} px in ${box.clientWidth}`);
  const pen = document.createElement("canvas").getContext("2d");
  for (const select of shown.filter((one) => one.tagName === "SELECT")) {
    const { font, paddingLeft, paddingRight } = getComputedStyle(select);
    pen.font = font;
    const text = Math.max(...[...select.options].map((option) => pen.measureText(option.textContent).width));
    const room = select.clientWidth - parseFloat(paddingLeft) - parseFloat(paddingRight) - arrow;
    if (text > room) cut.push(`SELECT ${select.id || select.name}: ${text.toFixed(0)} px in ${room.toFixed(0)}`);
  }
  return cut;
}"""


def cut_texts(page: Page) -> list[str]:
    """Return what does not fit now: texts outside their boxes, and boxes that would have to be moved sideways."""
    found: list[str] = page.evaluate(_CUT, _ARROW_PX)
    return found


def cut_texts_at_all_sizes(page: Page) -> list[str]:
    """Return the same at each of `SIZES`, with the width before it."""
    found = []
    for size in SIZES:
        page.set_viewport_size(size)
        found += [f"{size['width']} px wide: {text}" for text in cut_texts(page)]
    return found
