// Axes of a drawn plot that can show a part of their range: what is drawn moves within them, and they get new ticks.
"use strict";

const LEAST = 1e-3; // of the whole range
const STEPS = [[1], [1, 2, 5], [1, 1.5, 2, 3, 4, 5, 6, 7, 8, 9]];
const round = (value) => Math.round(100 * value) / 100;
const written = (value, digits) => String(+value.toPrecision(digits)).replace(/^-/, "\u2212");
const DECIBEL = 20;

function ticks(low, high, logarithmic) {
  for (const steps of logarithmic ? STEPS : []) {
    const found = [];
    for (let k = -20; k <= 20; k++) found.push(...steps.map((m) => +`${m}e${k}`).filter((v) => v >= low && v <= high));
    if (found.length > 2) return found;
  }
  const least = (high - low) / 6, unit = 10 ** Math.floor(Math.log10(least));
  const step = unit * [1, 2, 5, 10].find((m) => m * unit >= least);
  const found = [];
  for (let k = Math.ceil(low / step); k * step <= high; k++) found.push(k * step);
  return found;
}

// Ticks that an engineer looks for: every 20 dB and the like, where so much is shown.
function decibels(low, high) {
  const step = [1, 2, 5, 10, 20, 40, 100].find((one) => (high - low) / one <= 6);
  if (!step || high - low < 3) return ticks(low, high, false);
  const found = [];
  for (let k = Math.ceil(low / step); k * step <= high; k++) found.push(k * step);
  return found;
}

// One side of a pair of axes: `whole` and `view` are ends in decades or units, `start` and `length` in units of the drawing.
class Side {
  constructor({ scale, ends, unit }, start, length) {
    Object.assign(this, { fixed: scale === "fixed", logarithmic: scale === "log", unit, start, length, shown: null });
    this.whole = this.view = this.logarithmic ? ends.map(Math.log10) : ends;
  }
  get size() { return this.view[1] - this.view[0]; }
  get zoomed() { return this.size < (1 - 1e-9) * (this.whole[1] - this.whole[0]); }
  value(place) { return this.logarithmic ? 10 ** place : place; }
  // A value with its unit: the drawn one, or the one that `shown` asks for.
  written(value, digits) {
    const { factor, decibel, unit } = this.shown ?? { factor: 1, decibel: false, unit: this.unit };
    return `${written(decibel ? DECIBEL * Math.log10(factor * value) : factor * value, digits)} ${unit}`.trim();
  }
  at(pixel) { return this.view[0] + ((pixel - this.start) / this.length) * this.size; }
  pixel(place) { return this.start + ((place - this.view[0]) / this.size) * this.length; }
  show(from, to) {
    const [low, high] = this.whole;
    const size = this.fixed ? high - low : Math.min(high - low, Math.max(LEAST * (high - low), to - from));
    const start = Math.min(high - size, Math.max(low, (from + to - size) / 2));
    this.view = [start, start + size];
  }
  // Factor and shift from where something was drawn at first to where it is in the view.
  get move() {
    const factor = (this.whole[1] - this.whole[0]) / this.size;
    return [factor, this.pixel(this.whole[0]) - factor * this.start];
  }
  get ticks() {
    const [low, high] = this.view.map((end) => this.value(end)), { factor, decibel } = this.shown ?? { factor: 1 };
    if (decibel) {
      const ends = this.view.map((end) => DECIBEL * (end + Math.log10(factor)));
      return decibels(...ends).map((v) => [v, this.pixel(v / DECIBEL - Math.log10(factor))]);
    }
    return ticks(factor * low, factor * high, this.logarithmic).map((v) => [v, this.pixel(this.logarithmic ? Math.log10(v / factor) : v / factor)]);
  }
}

class Plane {
  constructor(group, { box: [left, top, width, height], x, y, curves }) {
    this.sides = [new Side(x, left, width), new Side(y, top + height, -height)];
    this.axes = [...group.children].filter((one) => /matplotlib\.axis_\d+$/.test(one.id));
    const drawn = [...group.children].filter((one) => !this.axes.includes(one));
    const found = (selector) => drawn.flatMap((one) => [...one.querySelectorAll(selector)]);
    const placed = (one) => [one, +one.getAttribute("x"), +one.getAttribute("y")];
    this.paths = found("path[clip-path]").map((one) => [one, one.getAttribute("d")]);
    this.marks = found("g[clip-path] > use").map(placed);
    this.words = found("text[x]").filter((one) => !one.closest('[id*="legend_"]')).map(placed);
    this.added = [];
    this.named = curves;
    this.label = [...(this.axes[1]?.children ?? [])].filter((one) => !/[xy]tick_\d+$/.test(one.id)).map((one) => one.querySelector("text")).find(Boolean);
    this.words = this.words.filter(([one]) => one !== this.label);
    this.labelled = this.label?.textContent ?? "";
  }
  // What a plane shows, without its unit: the beginning of a value that is read from it.
  get title() { return this.labelled.replace(/\s*\([^()]*\)$/, "").replace(/^(magnitude|phase)$/, ""); }
  // Show values per unit in another unit, null for as they were drawn; planes of another unit stay.
  scale(shown) {
    const side = this.sides[1];
    if (side.unit !== "pu") return;
    side.shown = shown && (side.logarithmic || !shown.decibel) ? shown : null;
    if (this.label) this.label.textContent = this.labelled.replace("(pu)", `(${side.shown?.unit ?? "pu"})`);
  }
  holds(x, y) {
    return this.sides.every((side, k) => Math.abs([x, y][k] - side.start - side.length / 2) <= Math.abs(side.length) / 2 + 1);
  }
  draw() {
    const [[ax, bx], [ay, by]] = this.sides.map((side) => side.move);
    const put = (one, x, y) => { one.setAttribute("x", round(x)); one.setAttribute("y", round(y)); };
    const moved = (_, x, y) => `${round(ax * x + bx)} ${round(ay * y + by)}`;
    for (const [one, d] of this.paths) one.setAttribute("d", d.replace(/(-?[\d.]+) (-?[\d.]+)/g, moved));
    for (const [one, x, y] of this.marks) // an area is drawn from the edge of the page, a mark where it belongs
      if (x === 0) one.setAttribute("transform", `matrix(${ax} 0 0 ${ay} ${bx} ${by})`);
      else put(one, ax * x + bx, ay * y + by);
    for (const [one, x, y] of this.words) {
      put(one, ax * x + bx, ay * y + by);
      one.removeAttribute("transform"); // a turn by zero
      one.style.visibility = this.holds(ax * x + bx, ay * y + by) ? "" : "hidden";
    }
    this.added.forEach((one) => one.remove());
    this.added = this.sides.flatMap((side, k) => this.ticks(side, k));
  }
  // Ticks of the view: copies of the first one that was drawn, moved to their places.
  ticks(side, k) {
    const given = [...(this.axes[k]?.children ?? [])].filter((one) => /[xy]tick_\d+$/.test(one.id));
    given.forEach((one) => (one.style.display = side.zoomed || side.shown ? "none" : ""));
    if (!(side.zoomed || side.shown) || !given.length) return [];
    const other = this.sides[1 - k], first = +given[0].querySelector("use").getAttribute("xy"[k]);
    return side.ticks.map(([value, pixel]) => {
      const copy = given[0].cloneNode(true);
      copy.style.display = "";
      copy.querySelectorAll("defs").forEach((one) => one.remove());
      [copy, ...copy.querySelectorAll("[id]")].forEach((one) => one.removeAttribute("id"));
      const ends = [other.start, other.start + other.length].map((end) => (k ? [end, pixel] : [pixel, end]).map(round));
      copy.querySelector("path")?.setAttribute("d", `M ${ends[0].join(" ")} L ${ends[1].join(" ")}`);
      for (const one of copy.querySelectorAll("use, text"))
        one.setAttribute("xy"[k], round(+one.getAttribute("xy"[k]) + pixel - first));
      for (const one of copy.querySelectorAll("text")) {
        one.removeAttribute("transform");
        one.textContent = written(value, 6);
      }
      return this.axes[k].insertBefore(copy, given[0]);
    });
  }
}
