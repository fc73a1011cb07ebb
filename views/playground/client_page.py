"""The page that a browser gets: viser's client, with names for screen readers, words that can be
read on light and on dark, and the verdict in sight on a phone.
"""

from __future__ import annotations

import gzip
from typing import Any

ADDED = """
<style>
:root[data-mantine-color-scheme] { --mantine-color-dimmed: #5b6672 !important; }
:root[data-mantine-color-scheme="dark"] { --mantine-color-dimmed: #a9b4c0 !important; }
.mantine-Slider-markLabel, .mantine-Notification-description { color: var(--mantine-color-dimmed) !important; }
[data-mantine-color-scheme="dark"] [data-dock-tab][aria-selected="true"] { color: #9db4f0 !important;
  box-shadow: inset 0 -2px 0 0 #9db4f0 !important; }
#stancekit-verdict { display: none; }
@media (max-width: 700px) {
  #stancekit-verdict { display: block; position: fixed; z-index: 1000; left: 0; right: 0; top: 0; max-height: 34vh;
    overflow: auto; padding: 2px 8px; background: Canvas; color: CanvasText; color-scheme: light;
    box-shadow: 0 1px 4px rgba(0, 0, 0, .35); }
  [data-mantine-color-scheme="dark"] #stancekit-verdict { color-scheme: dark; }
}
</style>
<script>
(() => {
  const words = element => (element?.textContent || "").trim().replace(/\\s+/g, " ");
  const set = (element, name, value) => {
    if (element.getAttribute(name) !== value) element.setAttribute(name, value);
  };
  // The nearest words before a control, in the row that it is in: viser writes them there without tying them to it.
  const label = control => {
    for (let row = control.parentElement, k = 0; row && k < 8; row = row.parentElement, k++) {
      const found = [...row.querySelectorAll("label, .mantine-Text-root, .mantine-InputWrapper-label")]
        .find(each => words(each) && !each.contains(control) &&
          (each.compareDocumentPosition(control) & Node.DOCUMENT_POSITION_FOLLOWING));
      if (found) return words(found);
    }
    return "";
  };
  // Where no words are near, the name of the drawing: viser's icons carry theirs as a class.
  const icon = element => [...element?.querySelectorAll("svg[class*=tabler-icon-]") || []]
    .flatMap(each => [...each.classList]).find(name => name.startsWith("tabler-icon-"))
    ?.replace("tabler-icon-", "").replaceAll("-", " ") || "";
  let due = false;
  const look = () => {
    due = false;
    set(document.documentElement, "lang", "en");
    for (const control of document.querySelectorAll("[role=slider], input:not([type=hidden]), [role=combobox]")) {
      if (control.labels?.length && words(control.labels[0])) continue;
      const name = label(control) || (/^wss?:/.test(control.value) ? "address of the server" : "");
      if (name) set(control, "aria-label", control.tagName === "INPUT" && control.inputMode !== "" &&
        control.closest(".mantine-NumberInput-root") ? name + ", number" : name);
    }
    for (const button of document.querySelectorAll("button"))
      if (!words(button) && !button.getAttribute("aria-label")) {
        const closes = button.closest("[role=alert]") && "Close this message";
        const near = button.title || closes || icon(button) || label(button);
        if (near) set(button, "aria-label", near);
      }
    for (const canvas of document.querySelectorAll("canvas"))
      { set(canvas, "role", "img"); set(canvas, "aria-label", "The scene in three dimensions"); }
    const verdict = document.querySelector("#verdict");
    let copy = document.querySelector("#stancekit-verdict");
    if (!copy) {
      copy = document.createElement("div");
      copy.id = "stancekit-verdict";
      copy.setAttribute("aria-hidden", "true");
      document.body.append(copy);
    }
    const shown = verdict ? verdict.outerHTML.replace('id="verdict"', "") : "";
    if (copy.dataset.shown !== shown) { copy.dataset.shown = shown; copy.innerHTML = shown; }
    if (verdict) { set(verdict, "role", "status"); }
  };
  const later = () => { if (!due) { due = true; setTimeout(look, 50); } };
  addEventListener("DOMContentLoaded", () => {
    new MutationObserver(later).observe(document.body, {childList: true, subtree: true, characterData: true});
    look();
  });
})();
</script>"""


def finished_page(request: Any, response: Any) -> Any:
    """The answer to a request for a page or one of its parts: what we add is in the page itself."""
    kind = "" if response is None else response.headers.get("Content-Type", "")
    if response is None or response.status_code != 200 or not kind.startswith("text/html"):
        return response
    zipped = response.headers.get("Content-Encoding") == "gzip"
    text = (gzip.decompress(response.body) if zipped else response.body).decode()
    text = text.replace("<title>Viser</title>", f"<title>Stancekit playground</title>{ADDED}", 1)
    body = gzip.compress(text.encode()) if zipped else text.encode()
    del response.headers["Content-Length"]
    response.headers["Content-Length"] = str(len(body))
    response.body = body
    return response
