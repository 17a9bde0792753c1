// Zoom of the block diagrams: buttons, the keys + - 0, and the wheel with Ctrl; the region around scrolls.

for (const svg of document.querySelectorAll("svg.diagram")) {
  const region = svg.closest(".scroll"), whole = svg.viewBox.baseVal.width;
  if (!region) continue;
  let size = 0; // 0: as wide as there is room
  const bar = Object.assign(document.createElement("p"), { className: "zoombar" });
  const show = (wanted, at = 0.5) => {
    const before = svg.getBoundingClientRect().width, left = region.scrollLeft + at * region.clientWidth;
    size = wanted && Math.min(Math.max(wanted, 0.3), 6);
    svg.style.width = svg.style.maxWidth = svg.style.minWidth = size ? `${size * whole}px` : "";
    if (!size) svg.style.maxWidth = `${whole}px`;
    const factor = svg.getBoundingClientRect().width / before;
    region.scrollLeft = left * factor - at * region.clientWidth;
  };
  const now = () => svg.getBoundingClientRect().width / whole;
  const ways = { "+": () => show(now() * 1.4), "\u2212": () => show(now() / 1.4), "fit": () => show(0) };
  for (const [words, press] of Object.entries(ways)) {
    const button = Object.assign(document.createElement("button"), { type: "button", textContent: words });
    button.setAttribute("aria-label", { "+": "enlarge the diagram", "\u2212": "make the diagram smaller" }[words] ?? "fit the diagram");
    button.addEventListener("click", press);
    bar.append(button);
  }
  region.before(bar);
  region.addEventListener("keydown", (event) => {
    const press = { "+": ways["+"], "=": ways["+"], "-": ways["\u2212"], "0": ways.fit }[event.key];
    if (!press || event.ctrlKey || event.metaKey || event.altKey) return;
    press();
    event.preventDefault();
  });
  region.addEventListener("wheel", (event) => {
    if (!event.ctrlKey) return;
    event.preventDefault();
    const box = region.getBoundingClientRect();
    show(now() * Math.exp(-event.deltaY / 300), (event.clientX - box.left) / box.width);
  }, { passive: false });
}

// A link to a folded section opens it.
const unfold = () => {
  const there = location.hash.length > 1 && document.getElementById(location.hash.slice(1))?.querySelector(":scope > details");
  if (there) there.open = true;
};
addEventListener("hashchange", unfold);
unfold();
