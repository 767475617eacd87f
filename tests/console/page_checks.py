"""What every page of the console must be: free of barriers, large enough for a glove, nothing cut off, STOP never covered."""

from __future__ import annotations

from typing import Any

from playwright.sync_api import Page

from cellctl.console.build import WEB

AXE = WEB / "node_modules" / "axe-core" / "axe.min.js"
TAGS = ("wcag2a", "wcag2aa", "wcag21a", "wcag21aa")
TOUCH_PX = 46  # 12 mm at 96 dpi
STATE_CAPS_MM = 9.0  # 0.17 degrees at three metres
CAPS = 0.70  # of the font's size, the least of the usual fonts (Segoe UI 0.70, Roboto 0.71, DejaVu Sans 0.73)
MM_PX = 96 / 25.4
NOT_AT_THE_MACHINE = ".skip, .proof-report"
"""Controls that no glove presses: the skip link is the keyboard's, the proof's report is read at a desk."""

SMALL = """([least, exempt]) => [...document.querySelectorAll('button, a[href], input, select, textarea, summary, [role=button], [role=tab]')]
  .filter((one) => !one.matches(exempt) && one.checkVisibility({ visibilityProperty: true }) && !one.closest('[inert]'))
  .map((one) => [one, (one.matches('[type=checkbox], [type=radio], [type=file]') && one.closest('label')) || one])
  .map(([one, target]) => [one, target.getBoundingClientRect()])
  .filter(([, box]) => box.width > 0 && (box.width < least - 0.5 || box.height < least - 0.5))
  .map(([one, box]) => [one.tagName, one.className, `"${(one.textContent || one.name || '').trim().slice(0, 30)}"`,
    box.width.toFixed(0), 'x', box.height.toFixed(0)].join(' '))"""

KEY_ELEMENTS = ".state-word, .remaining b, .stale-mark, .rail button span, .controls .control, .footer .small, .control-bar .control, .reset-button"

CUT_OFF = """(names) => [...document.querySelectorAll(names)]
  .filter((one) => one.checkVisibility() && (one.scrollWidth > one.clientWidth + 1 && getComputedStyle(one).display !== 'inline'
    || one.getBoundingClientRect().right > innerWidth + 1 || one.parentElement.scrollWidth > one.parentElement.clientWidth + 1))
  .map((one) => `${one.className} "${one.textContent}" ${one.scrollWidth} > ${one.clientWidth}`)"""

SIDEWAYS = """() => [document.documentElement, document.body, ...document.querySelectorAll('.page, .page > *, .content')]
  .filter((one) => one.scrollWidth > one.clientWidth + 1)
  .map((one) => `${one.tagName} ${one.className} ${one.scrollWidth} > ${one.clientWidth}`)"""

STOP_COVERED = """() => {
  const box = document.getElementById('stop-button').getBoundingClientRect();
  const places = [[0.5, 0.5], [0.06, 0.1], [0.94, 0.1], [0.06, 0.9], [0.94, 0.9]];
  return places.map(([x, y]) => document.elementFromPoint(box.left + x * box.width, box.top + y * box.height))
    .filter((one) => one?.id !== 'stop-button').map((one) => one?.outerHTML.slice(0, 120) ?? 'nothing');
}"""

AXE_RUN = """async ([tags, rules]) => {
  const runOnly = rules.length ? { type: 'rule', values: rules } : { type: 'tag', values: tags };
  const found = await axe.run(document, { resultTypes: ['violations'], runOnly });
  return found.violations.flatMap(({ id, nodes }) => nodes.map(({ html, any, all, none }) =>
    `${id}: ${html.slice(0, 160)} (${[...any, ...all, ...none].map(({ message }) => message).join('; ').slice(0, 240)})`));
}"""


def barriers(page: Page, *rules: str) -> list[str]:
    """What axe finds against WCAG 2.1 A and AA, or against these rules of axe alone; its script comes in beside the page's policy."""
    if not page.evaluate("'axe' in window"):
        page.evaluate(AXE.read_text(encoding="utf-8"))
    found: list[str] = page.evaluate(AXE_RUN, [list(TAGS), list(rules)])
    return found


def barriers_in_both_lights(page: Page) -> list[str]:
    """What axe finds in the dark, and against the contrast in the light; the page is dark again afterwards."""
    found: list[str] = []
    for theme, rules in (("light", ("color-contrast",)), ("dark", ())):  # only the contrast is a matter of light
        page.evaluate("(theme) => { document.documentElement.dataset.theme = theme }", theme)
        found += [f"{theme}: {one}" for one in barriers(page, *rules)]
    return found


def faults_of_form(page: Page) -> list[str]:
    """Everything that is too small, cut off, sideways, or over STOP."""
    asked: tuple[tuple[str, str, Any], ...] = (
        ("too small", SMALL, [TOUCH_PX, NOT_AT_THE_MACHINE]),
        ("cut off", CUT_OFF, KEY_ELEMENTS),
        ("sideways", SIDEWAYS, None),
        ("over STOP", STOP_COVERED, None),
    )
    return [f"{what}: {one}" for what, script, given in asked for one in page.evaluate(script, given)]


def caps_mm(page: Page, selector: str) -> float:
    """Height of the capitals of a word on the page, mm at 96 dpi."""
    size = page.locator(selector).first.evaluate("(one) => parseFloat(getComputedStyle(one).fontSize)")
    return float(size) * CAPS / MM_PX
