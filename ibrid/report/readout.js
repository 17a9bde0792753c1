// Values of the curves under the cursor: of one figure, and of all that share its frequency.

// A curve as it was drawn: places along x (decades or units) and along y. A line is read between its points, dots at the next one.
class Curve {
  constructor(svg, [end, name], { sides, paths, marks }) {
    const group = svg.querySelector(`g[id$="-${end}"]`), drawn = paths.find(([one]) => one.parentElement === group);
    const dots = marks.filter(([one]) => group?.contains(one)), line = drawn?.[0]; // as they were drawn, whatever is shown
    const place = (side, pixel) => side.whole[0] + ((pixel - side.start) / side.length) * (side.whole[1] - side.whole[0]);
    Object.assign(this, { name, read: !dots.length });
    this.colour = (line ?? dots[0]?.[0])?.style.stroke || "currentColor";
    const pairs = dots.length
      ? dots.map(([, x, y]) => [x, y, false])
      : [...(drawn?.[1] ?? "").matchAll(/([ML]) (-?[\d.]+) (-?[\d.]+)/g)].map(([, kind, x, y]) => [+x, +y, kind === "M"]);
    this.points = pairs.map(([x, y, first]) => [place(sides[0], x), place(sides[1], y), first]);
  }
  // The places along x and y that are read at a place along x, null where there are none; `near` : how far away a dot may be.
  at(x, near) {
    if (!this.read) {
      const best = this.points.reduce((one, other) => (Math.abs(other[0] - x) < Math.abs((one?.[0] ?? Infinity) - x) ? other : one), null);
      return best && Math.abs(best[0] - x) <= near ? best : null;
    }
    for (let k = 1; k < this.points.length; k++) {
      const [a, b] = [this.points[k - 1], this.points[k]];
      if (b[2] || x < Math.min(a[0], b[0]) || x > Math.max(a[0], b[0])) continue;
      return [x, a[0] === b[0] ? a[1] : a[1] + ((x - a[0]) / (b[0] - a[0])) * (b[1] - a[1])];
    }
    return null;
  }
}

// What a figure says at a place along x: a line through its planes, and a box with a row for each curve.
class Readout {
  constructor(plot, figure) {
    Object.assign(this, { plot, lines: [] });
    this.box = figure.appendChild(Object.assign(document.createElement("div"), { className: "told" }));
    this.box.setAttribute("role", "status");
  }
  get curves() {
    return (this.kept ??= this.plot.planes.map((plane) => plane.named.map((one) => new Curve(this.plot.svg, one, plane))));
  }
  // The rows: name, colour and, for each plane that has the curve, its value.
  rows(x) {
    const rows = new Map();
    this.plot.planes.forEach((plane, k) => {
      const [across, up] = plane.sides, near = 0.015 * across.size;
      for (const curve of this.curves[k]) {
        const found = curve.at(x, near);
        if (!found) continue;
        const [where, y] = found, name = curve.read ? curve.name : `${curve.name} at ${across.written(across.value(where), 4)}`;
        const row = rows.get(name) ?? rows.set(name, { colour: curve.colour, values: [] }).get(name);
        row.values.push(`${plane.title ? `${plane.title} ` : ""}${up.written(up.value(y), 3)}`);
      }
    });
    return rows;
  }
  show(x) {
    const [across] = this.plot.planes[0].sides, rows = this.rows(x), pixel = across.pixel(x);
    const head = Object.assign(document.createElement("b"), { textContent: across.written(across.value(x), 4) });
    this.box.replaceChildren(head);
    for (const [name, { colour, values }] of rows) {
      const row = document.createElement("div"), key = document.createElement("i");
      key.style.background = colour;
      row.append(key, `${name}: ${values.join(", ")}`);
      this.box.append(row);
    }
    this.box.classList.toggle("left", pixel > across.start + across.length / 2);
    this.lines.forEach((one) => one.remove());
    this.lines = this.plot.planes.map(({ sides: [, side] }) => {
      const line = this.plot.svg.appendChild(document.createElementNS(this.plot.svg.namespaceURI, "line"));
      const places = { class: "cursor", x1: pixel, x2: pixel, y1: side.start, y2: side.start + side.length };
      Object.entries(places).forEach((one) => line.setAttribute(...one));
      return line;
    });
  }
  hide() {
    this.lines.forEach((one) => one.remove());
    this.lines = [];
    this.box.replaceChildren();
  }
}
