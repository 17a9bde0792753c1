// Zoom of the plots by mouse, touch and keyboard; those over frequency in one section follow each other.
// svg[data-axes] holds for each of its axes the box in units of the drawing and, for x and y, the scale and its ends.

const HINT = "Drag across a plot to enlarge a part; double-click, or the key 0, shows all again. Keys in a plot: + - and arrows; with Shift they move the cursor, which reads the curves.";

class Plot {
  constructor(svg) {
    const groups = svg.querySelectorAll('g[id*="-axes_"]');
    this.planes = JSON.parse(svg.dataset.axes).map((one, k) => new Plane(groups[k], one));
    this.linked = svg.dataset.link === "yes"; // by their frequency, with all others of the section
    Object.assign(this, { svg, section: svg.closest("section"), frame: null, start: null });
    svg.classList.add("zoomable");
    svg.tabIndex = 0;
    svg.setAttribute("aria-keyshortcuts", "+ - 0 ArrowLeft ArrowRight ArrowUp ArrowDown");
    const figure = svg.closest("figure") ?? svg.parentElement;
    this.back = figure.appendChild(Object.assign(document.createElement("button"), { type: "button", hidden: true }));
    this.back.textContent = "show all";
    this.readout = new Readout(this, figure);
    this.back.addEventListener("click", () => { this.all(); svg.focus(); });
    svg.addEventListener("dblclick", () => this.all());
    svg.addEventListener("keydown", (event) => this.key(event));
    svg.addEventListener("pointerdown", (event) => this.press(event));
    svg.addEventListener("pointermove", (event) => this.move(event));
    svg.addEventListener("pointerup", (event) => this.release(event));
    svg.addEventListener("pointercancel", () => this.forget());
    svg.addEventListener("pointerleave", (event) => { this.forget(); if (event.pointerType !== "touch") this.read(null); });
    svg.addEventListener("blur", () => this.read(null));
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
  // Show the values at a place along x, here and in all plots that hang together; null: nowhere.
  read(x) {
    this.cursor = x;
    for (const plot of this.peers) {
      if (x === null || !plot.svg.checkVisibility()) plot.readout.hide();
      else plot.readout.show(x);
    }
  }
  step(by) {
    const { view: [from, to], size } = this.planes[0].sides[0];
    this.read(Math.min(to, Math.max(from, (this.cursor ?? (from + to) / 2) + by * size)));
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
    else if (event.shiftKey && (key === "ArrowLeft" || key === "ArrowRight")) this.step(key === "ArrowLeft" ? -0.01 : 0.01);
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
    this.move(event);
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
    this.read(plane && !plane.sides[0].fixed ? plane.sides[0].at(at[0]) : null);
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
  }
}

const plots = [...document.querySelectorAll("svg[data-axes]")].map((svg) => new Plot(svg));
for (const section of new Set(plots.map((one) => one.section))) {
  const first = section.querySelector("svg[data-axes]");
  const hint = Object.assign(document.createElement("p"), { className: "note hint", textContent: HINT });
  (first.closest(".four") ?? first.closest("figure")).before(hint);
}
