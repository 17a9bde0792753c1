// Zoom of the plots by mouse, touch and keyboard; those over frequency in one section follow each other.
// svg[data-axes] holds for each of its axes the box in units of the drawing and, for x and y, the scale and its ends.

const HINT = "Drag across a plot to enlarge a part; double-click, or the key 0, shows all again. Keys in a plot: + - and arrows.";

class Plot {
  constructor(svg) {
    const groups = svg.querySelectorAll('g[id*="-axes_"]');
    this.planes = JSON.parse(svg.dataset.axes).map((one, k) => new Plane(groups[k], one));
    this.linked = svg.dataset.link === "yes"; // by their frequency, with all others of the section
    Object.assign(this, { svg, section: svg.closest("section"), frame: null, start: null });
    svg.classList.add("zoomable");
    svg.tabIndex = 0;
    svg.setAttribute("aria-keyshortcuts", "+ - 0 ArrowLeft ArrowRight ArrowUp ArrowDown");
    const figure = svg.closest("figure");
    this.back = figure.appendChild(Object.assign(document.createElement("button"), { type: "button", hidden: true }));
    this.back.textContent = "show all";
    this.told = figure.appendChild(Object.assign(document.createElement("span"), { className: "told" }));
    this.back.addEventListener("click", () => { this.all(); svg.focus(); });
    svg.addEventListener("dblclick", () => this.all());
    svg.addEventListener("keydown", (event) => this.key(event));
    svg.addEventListener("pointerdown", (event) => this.press(event));
    svg.addEventListener("pointermove", (event) => this.move(event));
    svg.addEventListener("pointerup", (event) => this.release(event));
    for (const name of ["pointercancel", "pointerleave"]) svg.addEventListener(name, () => this.forget());
  }
  get peers() { return this.linked ? plots.filter((one) => one.linked && one.section === this.section) : [this]; }
  draw() {
    this.planes.forEach((plane) => plane.draw());
    this.back.hidden = !this.planes.some((plane) => plane.sides.some((side) => side.zoomed));
  }
  all() {
    for (const plot of this.peers) {
      plot.planes.forEach((plane) => plane.sides.forEach((side) => side.show(...side.whole)));
      plot.draw();
    }
  }
  // Show a part of side k: of x in all plots that hang together, of y in this plane alone.
  show(plane, k, from, to) {
    for (const plot of k ? [this] : this.peers) {
      (k ? [plane] : plot.planes).forEach((one) => one.sides[k].show(from, to));
      plot.draw();
    }
  }
  key(event) {
    if (event.ctrlKey || event.metaKey || event.altKey) return;
    const plane = this.planes[0], sides = this.linked ? [0] : [0, 1];
    const by = (k, factor, shift) => {
      const { view: [from, to], size } = plane.sides[k], middle = (from + to) / 2 + shift * size;
      this.show(plane, k, middle - (factor * size) / 2, middle + (factor * size) / 2);
    };
    const { key } = event;
    if (key === "+" || key === "=") sides.forEach((k) => by(k, 0.6, 0));
    else if (key === "-") sides.forEach((k) => by(k, 1 / 0.6, 0));
    else if (key === "0" || key === "Escape") this.all();
    else if (key === "ArrowLeft" || key === "ArrowRight") by(0, 1, key === "ArrowLeft" ? -0.2 : 0.2);
    else if ((key === "ArrowUp" || key === "ArrowDown") && !this.linked) by(1, 1, key === "ArrowDown" ? -0.2 : 0.2);
    else return;
    event.preventDefault();
  }
  point(event) {
    const { x, y } = new DOMPoint(event.clientX, event.clientY).matrixTransform(this.svg.getScreenCTM().inverse());
    return [x, y];
  }
  press(event) {
    const at = this.point(event), plane = this.planes.find((one) => one.holds(...at));
    if (!plane || event.button) return;
    this.start = { plane, at };
    this.svg.setPointerCapture(event.pointerId);
  }
  // What a drag marks: [from, to] of x and y, all of a side along which it moved little.
  marked(event) {
    const { plane, at } = this.start, now = this.point(event), touch = event.pointerType === "touch";
    return plane.sides.map((side, k) => {
      const ends = [side.start, side.start + side.length].sort((a, b) => a - b);
      const marked = [at[k], now[k]].map((one) => Math.min(ends[1], Math.max(ends[0], one))).sort((a, b) => a - b);
      const few = k ? 0.1 * (ends[1] - ends[0]) : 4;
      return marked[1] - marked[0] > few && !side.fixed && !(k && touch) ? [marked, true] : [ends, false];
    });
  }
  move(event) {
    const at = this.point(event), plane = this.planes.find((one) => one.holds(...at));
    this.told.textContent = !plane ? "" : plane.sides.filter((side) => !side.fixed)
      .map((side, k) => `${written(side.value(side.at(at[k])), 3)} ${side.unit}`.trim()).join(", ");
    if (!this.start) return;
    const [[[left, right]], [[top, bottom]]] = this.marked(event);
    this.frame ??= this.svg.appendChild(document.createElementNS(this.svg.namespaceURI, "rect"));
    Object.entries({ class: "frame", x: left, y: top, width: right - left, height: bottom - top })
      .forEach((one) => this.frame.setAttribute(...one));
  }
  release(event) {
    if (!this.start) return;
    const { plane } = this.start, marked = this.marked(event);
    this.forget();
    marked.forEach(([ends, meant], k) => {
      if (meant) this.show(plane, k, ...ends.map((end) => plane.sides[k].at(end)).sort((a, b) => a - b));
    });
  }
  forget() {
    this.frame?.remove();
    this.frame = this.start = null;
    this.told.textContent = "";
  }
}

const plots = [...document.querySelectorAll("svg[data-axes]")].map((svg) => new Plot(svg));
for (const section of new Set(plots.map((one) => one.section))) {
  const first = section.querySelector("svg[data-axes]");
  const hint = Object.assign(document.createElement("p"), { className: "note hint", textContent: HINT });
  (first.closest(".four") ?? first.closest("figure")).before(hint);
}
