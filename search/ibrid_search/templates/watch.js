// The live page of ibrid watch: asks for the state every two seconds, draws curve and lineage, opens candidates in a frame.

const SVG = "http://www.w3.org/2000/svg";
const at = (id) => document.getElementById(id);
const written = (x) => (x === null ? "-" : Math.abs(x) < 1e-3 ? x.toExponential(2) : x.toPrecision(3));
let chosen = null, shown = "";

function put(parent, name, attributes, words) {
  const made = document.createElementNS(SVG, name);
  for (const [key, value] of Object.entries(attributes)) made.setAttribute(key, value);
  if (words !== undefined) made.textContent = words;
  return parent.appendChild(made);
}

function choose(step) {
  chosen = step;
  at("chosen").textContent = `Candidate: step ${step}`;
  at("candidate").src = `/step/${step}`;
}

function dot(svg, node, x, y, best) {
  const style = `${node.stable === false ? "unstable " : ""}${node.step === best ? "best" : ""}`;
  const made = put(svg, "circle", { cx: x, cy: y, r: node.step === best ? 6 : 4, class: style, tabindex: 0, role: "button", "data-step": node.step });
  put(made, "title", {}, `step ${node.step}: NRMSE ${written(node.nrmse)}${node.note ? `, ${node.note}` : ""}`);
  made.addEventListener("click", () => choose(node.step));
  made.addEventListener("keydown", (event) => { if (event.key === "Enter") choose(node.step); });
}

function curve(state) {
  const svg = at("curve"), points = state.points.filter((one) => one[1] > 0);
  svg.replaceChildren();
  if (!points.length) return;
  const logs = points.map((one) => Math.log10(one[1])), low = Math.floor(Math.min(...logs)), high = Math.max(Math.ceil(Math.max(...logs)), low + 1);
  const last = Math.max(...points.map((one) => one[0]), 1);
  // as many units as pixels, so that words keep their size on a telephone
  const width = Math.max(280, Math.round(svg.parentElement.clientWidth)), right = width - 20;
  svg.setAttribute("viewBox", `0 0 ${width} 260`);
  const x = (n) => 50 + ((right - 50) * n) / last, y = (v) => 230 - (210 * (Math.min(Math.log10(v), high) - low)) / (high - low);
  const every = Math.ceil((high - low) / 8);
  for (let k = low; k <= high; k += every) {
    put(svg, "line", { x1: 50, x2: right, y1: y(10 ** k), y2: y(10 ** k), class: "axis" });
    put(svg, "text", { x: 8, y: y(10 ** k) + 4 }, `1e${k}`);
  }
  put(svg, "text", { x: right, y: 250, "text-anchor": "end" }, `evaluation ${last}`);
  const nodes = new Map(state.nodes.map((one) => [one.step, one]));
  const best = points.filter((one) => one[2] > 0);
  if (best.length) put(svg, "path", { class: "line", d: best.map((one, k) => `${k ? `H${x(one[0])}V` : `M${x(one[0])} `}${y(one[2])}`).join("") });
  for (const [n, nrmse, , step] of points) if (nodes.has(step)) dot(svg, nodes.get(step), x(n), y(nrmse), state.best);
}

function tree(state) {
  const svg = at("tree"), nodes = new Map(state.nodes.map((one) => [one.step, { ...one, children: [] }]));
  svg.replaceChildren();
  const roots = [];
  for (const one of nodes.values()) (nodes.has(one.parent) ? nodes.get(one.parent).children : roots).push(one);
  const way = new Set();
  for (let one = nodes.get(state.best); one; one = nodes.get(one.parent)) way.add(one.step);
  let row = 0, deepest = 0;
  const place = (one, depth) => {
    deepest = Math.max(deepest, depth);
    Object.assign(one, { depth, row });
    one.children.sort((a, b) => way.has(b.step) - way.has(a.step) || a.nrmse - b.nrmse);
    one.children.forEach((child, k) => { if (k) row += 1; place(child, depth + 1); });
  };
  roots.forEach((one, k) => { if (k) row += 1; place(one, 0); });
  const step = Math.max(26, Math.min(90, 860 / (deepest + 1))), width = 40 + step * (deepest + 1), height = 30 + 18 * (row + 1);
  svg.setAttribute("viewBox", `0 0 ${width} ${height}`);
  svg.style.maxWidth = `${width}px`;
  const x = (one) => 20 + step * one.depth, y = (one) => 20 + 18 * one.row;
  for (const one of nodes.values()) {
    const parent = nodes.get(one.parent);
    if (parent) put(svg, "path", { class: `edge${way.has(one.step) ? " way" : ""}`, d: `M${x(parent)} ${y(parent)}V${y(one)}H${x(one)}` });
  }
  for (const one of nodes.values()) dot(svg, one, x(one), y(one), state.best);
}

async function ask() {
  try {
    const answer = await fetch("/state"), text = await answer.text();
    if (!answer.ok) throw new Error(JSON.parse(text).error);
    if (text !== shown) {
      const state = JSON.parse(text), best = state.nodes.find((one) => one.step === state.best);
      shown = text;
      at("name").textContent = `Search ${state.name}`;
      at("told").textContent = state.ending ? `ended: ${state.ending}` : `running, ${state.points.length} evaluations${state.budget ? ` of ${state.budget}` : ""}`;
      at("sentence").textContent = best ? `Best so far: step ${best.step}, NRMSE ${written(best.nrmse)}${best.note ? `: ${best.note}` : ""}` : "Nothing is fitted yet.";
      curve(state);
      tree(state);
      if (chosen === null && best) choose(best.step);
    }
  } catch (error) {
    at("told").textContent = `no answer: ${error.message}`;
  }
  setTimeout(ask, 2000);
}

async function look(file) {
  at("looked").textContent = `looking at ${file.name} ...`;
  const answer = await fetch(`/start?name=${encodeURIComponent(file.name)}`, { method: "POST", body: file });
  const told = await answer.json();
  at("looked").textContent = answer.ok ? told.sentence : told.error;
  if (answer.ok) {
    at("chosen").textContent = `First answer about ${file.name}`;
    at("candidate").src = told.page;
  }
}

// The frame is as tall as the page in it, so that nothing of a diagram is cut; the curve follows the width of the window.
const fit = () => {
  const page = at("candidate").contentDocument?.documentElement;
  if (page && at("candidate").contentWindow.location.protocol !== "about:") at("candidate").style.height = `${page.getBoundingClientRect().height + 4}px`;
};
at("candidate").addEventListener("load", () => {
  fit();
  const body = at("candidate").contentDocument?.body;
  if (body) new ResizeObserver(fit).observe(body);
});
addEventListener("resize", () => { shown = ""; });

const drop = at("drop");
at("file").addEventListener("change", (event) => { if (event.target.files[0]) look(event.target.files[0]); });
for (const name of ["dragover", "dragleave", "drop"]) drop.addEventListener(name, (event) => {
  event.preventDefault();
  drop.classList.toggle("over", name === "dragover");
  if (name === "drop" && event.dataTransfer.files[0]) look(event.dataTransfer.files[0]);
});
ask();
