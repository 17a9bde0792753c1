// The table of trials on the live page: sorted by any column, filtered by words, one parameter as a column of its own.

const at = (id) => document.getElementById(id);
const written = (x) => (x === null || x === undefined ? "-" : x === 0 ? "0" : Math.abs(x) < 1e-3 || Math.abs(x) >= 1e5 ? x.toExponential(2) : String(+x.toPrecision(4)));
const duration = (s) => {
  if (s === null || s === undefined) return "-";
  if (s < 10) return `${s.toFixed(1)} s`;
  const whole = Math.round(s), hours = Math.floor(whole / 3600), two = (n) => String(n).padStart(2, "0");
  return hours ? `${hours}:${two(Math.floor(whole / 60) % 60)}:${two(whole % 60)} h` : `${Math.floor(whole / 60)}:${two(whole % 60)} min`;
};
const range = ([low, high]) => (written(low) === written(high) ? written(low) : `${written(low)} to ${written(high)}`);

function made(name, attributes = {}, words) {
  const element = document.createElement(name);
  for (const [key, value] of Object.entries(attributes)) element.setAttribute(key, value);
  if (words !== undefined) element.textContent = words;
  return element;
}

class TrialTable {
  // choose : called with the step of a trial that was clicked.
  constructor(choose) {
    Object.assign(this, { choose, rows: [], units: {}, leftOut: 0, best: null, chosen: null, evaluations: new Map() });
    Object.assign(this, { column: "nrmse", rising: true });
    at("parameter").addEventListener("change", () => { if (at("parameter").value) this.column = "parameter"; this.draw(); });
    at("find").addEventListener("input", () => this.draw());
  }
  // name : (heading, value to sort by, whether it is a number)
  get columns() {
    const own = at("parameter").value, unit = this.units[own];
    return [
      ["evaluation", "evaluation", (one) => this.evaluations.get(one.step) ?? null],
      ["nrmse", "NRMSE", (one) => one.nrmse],
      ["stable", "stable", (one) => (one.stable === null ? null : +one.stable)],
      ["order", "order", (one) => one.order],
      ["free", "free", (one) => one.free],
      ...(own ? [["parameter", `${own}${unit ? ` (${unit})` : ""}`, (one) => one.parameters[own]?.[0] ?? null]] : []),
      ["seconds", "took", (one) => one.seconds],
      ["proposer", "proposer", (one) => one.proposer],
      ["note", "what", (one) => one.note || one.reason],
      ["difference", "changed", (one) => one.difference.length],
      ["parameters", "parameters", (one) => Object.keys(one.parameters).length],
    ];
  }
  show(table) {
    Object.assign(this, { rows: table.rows, units: table.units, leftOut: table.left_out });
    const kept = at("parameter").value, names = Object.keys(this.units).sort();
    at("parameter").replaceChildren(made("option", { value: "" }, "none"), ...names.map((name) => made("option", { value: name }, name)));
    at("parameter").value = names.includes(kept) ? kept : "";
    this.draw();
  }
  get sorted() {
    const columns = this.columns, [, , value] = columns.find(([name]) => name === this.column) ?? columns[1];
    const words = at("find").value.toLowerCase().split(/\s+/).filter(Boolean);
    const text = (one) => [one.note, one.reason, one.proposer, ...one.difference, ...Object.keys(one.parameters)].join(" ").toLowerCase();
    const sign = this.rising ? 1 : -1;
    return this.rows
      .filter((one) => words.every((word) => text(one).includes(word)))
      .sort((one, other) => {
        const [a, b] = [value(one), value(other)];
        if (a === null || b === null) return (a === null) - (b === null) || one.step - other.step; // what has no value comes last
        return sign * (typeof a === "string" ? a.localeCompare(b) : a - b) || one.step - other.step;
      });
  }
  draw() {
    const head = made("tr");
    for (const [name, words] of this.columns) {
      const cell = made("th", { scope: "col", ...(name === this.column ? { "aria-sort": this.rising ? "ascending" : "descending" } : {}) });
      const button = cell.appendChild(made("button", { type: "button", "data-column": name }, words));
      button.addEventListener("click", () => {
        this.rising = this.column === name ? !this.rising : true;
        this.column = name;
        this.draw();
        at("trials").querySelector(`button[data-column="${name}"]`).focus();
      });
      head.append(cell);
    }
    const rows = this.sorted;
    at("trials").tHead.replaceChildren(head);
    at("trials").tBodies[0].replaceChildren(...rows.map((one) => this.row(one)));
    const more = this.leftOut ? `; ${this.leftOut} of larger error are not listed` : "";
    at("counted").textContent = `${rows.length} of ${this.rows.length} trials${more}`;
  }
  row(one) {
    const classes = [one.step === this.best ? "best" : "", one.step === this.chosen ? "chosen" : ""].join(" ").trim();
    const row = made("tr", { "data-step": one.step, ...(classes ? { class: classes } : {}) });
    const header = row.appendChild(made("th", { scope: "row", class: "n" })), evaluation = this.evaluations.get(one.step) ?? "-";
    if (one.nrmse === null) header.append(evaluation);
    else header.append(made("button", { type: "button", "aria-label": `show evaluation ${evaluation}` }, evaluation));
    row.append(made("td", { class: "n" }, one.nrmse === null ? one.status : written(one.nrmse)));
    row.append(made("td", one.stable === false ? { class: "bad" } : {}, one.stable === null ? "" : one.stable ? "yes" : "NO"));
    row.append(made("td", { class: "n" }, one.order ?? "-"), made("td", { class: "n" }, one.free ?? "-"));
    const own = at("parameter").value;
    if (own) row.append(made("td", { class: "n" }, own in one.parameters ? range(one.parameters[own]) : "-"));
    row.append(made("td", { class: "n" }, duration(one.seconds)), made("td", {}, one.proposer));
    row.append(made("td", { class: "text" }, one.note || one.reason || "the start"));
    const parameters = Object.entries(one.parameters).map(([name, values]) => `${name} ${range(values)} ${this.units[name] ?? ""}`.trim());
    row.append(this.lines(one.difference, 2, "line"), this.lines(parameters, 0, "value"));
    row.addEventListener("click", (event) => { if (one.nrmse !== null && !event.target.closest("details")) this.choose(one.step); });
    return row;
  }
  // A cell with lines of code, of which more than `most` are folded.
  lines(texts, most, what) {
    const cell = made("td", { class: "text" });
    const codes = texts.map((text) => made("code", { class: text[0] === "+" ? "added" : text[0] === "-" ? "removed" : "" }, text));
    if (texts.length <= most) cell.append(...codes);
    else {
      const folded = cell.appendChild(made("details"));
      folded.append(made("summary", {}, `${texts.length} ${what}${texts.length === 1 ? "" : "s"}`), ...codes);
    }
    return cell;
  }
}
