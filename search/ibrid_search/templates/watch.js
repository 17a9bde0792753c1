// The live page of ibrid watch: asks for the state every two seconds, draws curve and lineage, opens candidates in a frame.

const SVG = "http://www.w3.org/2000/svg";
const TOKEN = document.querySelector('meta[name="ibrid-token"]').content;
let chosen = null, shown = "", run = 0, tried = "", others = [];
const table = new TrialTable((step) => choose(step));
const colour = (k) => `var(--series-${k % 6})`;

function put(parent, name, attributes, words) {
  const made = document.createElementNS(SVG, name);
  for (const [key, value] of Object.entries(attributes)) made.setAttribute(key, value);
  if (words !== undefined) made.textContent = words;
  return parent.appendChild(made);
}

function choose(step) {
  chosen = step;
  const evaluation = table.evaluations.get(step);
  at("chosen").textContent = `Candidate: ${evaluation ? `evaluation ${evaluation}` : `step ${step}`}`;
  at("candidate").src = `/step/${step}?run=${run}`;
  table.chosen = step;
  table.draw();
}

function dot(svg, node, x, y, best) {
  const style = `${node.stable === false ? "unstable " : ""}${node.step === best ? "best" : ""}`;
  const made = put(svg, "circle", { cx: x, cy: y, r: node.step === best ? 6 : 4, class: style, tabindex: 0, role: "button", "data-step": node.step });
  put(made, "title", {}, `evaluation ${table.evaluations.get(node.step) ?? "-"}: NRMSE ${written(node.nrmse)}${node.note ? `, ${node.note}` : ""}`);
  made.addEventListener("click", () => choose(node.step));
  made.addEventListener("keydown", (event) => { if (event.key === "Enter") choose(node.step); });
}

function curve(state) {
  const svg = at("curve"), points = state.points.filter((one) => one[1] > 0);
  svg.replaceChildren();
  if (!points.length) return;
  const beside = others.map((one, k) => ({ ...one, k })).filter((one) => one.k !== run && one.curve.length);
  const errors = [...points.map((one) => one[1]), ...beside.flatMap((one) => one.curve.map((two) => two[1]))].filter((one) => one > 0);
  const logs = errors.map(Math.log10), low = Math.floor(Math.min(...logs)), high = Math.max(Math.ceil(Math.max(...logs)), low + 1);
  const last = Math.max(...points.map((one) => one[0]), ...beside.map((one) => one.evaluations), 1);
  // as many units as pixels, so that words keep their size on a telephone
  const width = Math.max(280, Math.round(svg.parentElement.clientWidth)), left = 66, right = width - 20, bottom = 220;
  svg.setAttribute("viewBox", `0 0 ${width} 260`);
  const x = (n) => left + ((right - left) * n) / last, y = (v) => bottom - ((bottom - 20) * (Math.min(Math.log10(v), high) - low)) / (high - low);
  const every = Math.ceil((high - low) / 8);
  for (let k = low; k <= high; k += every) {
    put(svg, "line", { x1: left, x2: right, y1: y(10 ** k), y2: y(10 ** k), class: "axis" });
    put(svg, "text", { x: left - 8, y: y(10 ** k) + 4, "text-anchor": "end" }, `1e${k}`);
  }
  const unit = 10 ** Math.floor(Math.log10(Math.max(last / 6, 1))), step = Math.max(1, unit * [1, 2, 5, 10].find((m) => m * unit >= last / 6));
  for (let n = step; n <= last; n += step) {
    put(svg, "line", { x1: x(n), x2: x(n), y1: bottom, y2: bottom + 4, class: "axis" });
    put(svg, "text", { x: x(n), y: bottom + 16, "text-anchor": "middle" }, n);
  }
  put(svg, "text", { x: (left + right) / 2, y: 254, "text-anchor": "middle", class: "axis-name" }, "evaluation");
  put(svg, "text", { x: -(bottom + 20) / 2, y: 14, transform: "rotate(-90)", "text-anchor": "middle", class: "axis-name" }, "NRMSE");
  const stairs = (ends) => ends.map(([n, v], k) => `${k ? `H${x(n)}V` : `M${x(n)} `}${y(v)}`).join("");
  for (const one of beside) {
    const ends = one.curve.filter((two) => two[1] > 0);
    if (ends.length) put(svg, "path", { class: "other", style: `stroke:${colour(one.k)}`, d: `${stairs(ends)}H${x(one.evaluations)}` });
  }
  const nodes = new Map(state.nodes.map((one) => [one.step, one]));
  const best = points.filter((one) => one[2] > 0);
  if (best.length) put(svg, "path", { class: "line", style: `stroke:${colour(run)}`, d: stairs(best.map((one) => [one[0], one[2]])) });
  for (const [n, nrmse, , number] of points) if (nodes.has(number)) dot(svg, nodes.get(number), x(n), y(nrmse), state.best);
  const legend = others.length > 1 ? others : [];
  at("curves").replaceChildren(...legend.map((one, k) => {
    const item = made("li"), key = item.appendChild(document.createElementNS(SVG, "svg"));
    for (const [name, value] of Object.entries({ width: 34, height: 14, "aria-hidden": "true", style: "width:34px" })) key.setAttribute(name, value);
    put(key, "path", { d: "M0 7h34", style: `stroke:${colour(k)};stroke-width:2${k === run ? "" : ";stroke-dasharray:5 3"}`, fill: "none" });
    item.append(one.name);
    return item;
  }));
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

function header(state) {
  const { budget, evaluations } = state, best = state.nodes.find((one) => one.step === state.best);
  const stands = state.ending ? `ended: ${state.ending}` : state.stopping ? "ending after what is under way" : state.running ? "running" : "not running; go on with --resume";
  at("name").textContent = `Search ${state.name}`;
  at("told").textContent = `${stands}, ${evaluations} evaluations${budget ? ` of ${budget}` : ""}`;
  const where = best && table.evaluations.get(best.step);
  const lowest = state.nodes.find((one) => one.step === state.lowest), less = best && lowest && lowest.nrmse < 0.99 * best.nrmse;
  const why = less ? ` The least error is ${written(lowest.nrmse)}, at evaluation ${table.evaluations.get(lowest.step)}; the search also weighs the number of parameters and implausible values.` : "";
  at("sentence").textContent = best ? `Best so far: evaluation ${where}, NRMSE ${written(best.nrmse)}${best.note ? `: ${best.note}` : ""}` : "Nothing is fitted yet.";
  if (why) at("sentence").append(`.${why}`);
  const facts = { evaluations: `${evaluations}${budget ? ` of ${budget}` : ""}`, "NRMSE, best": written(best?.nrmse), elapsed: duration(state.seconds) };
  if (state.seconds_left !== null) facts["left, at most"] = duration(state.seconds_left);
  at("facts").replaceChildren(...Object.entries(facts).map(([name, value]) => {
    const fact = made("div");
    fact.append(made("dt", {}, name), made("dd", {}, value));
    return fact;
  }));
  at("stop").disabled = !state.running || state.stopping;
}

function runs() {
  const body = made("tbody"), names = ["run", "evaluations", "NRMSE, best", "elapsed", "left, at most", "how it stands"];
  const head = made("thead"), row = head.appendChild(made("tr"));
  row.append(...names.map((name) => made("th", { scope: "col" }, name)));
  others.forEach((one, k) => {
    const line = body.appendChild(made("tr", k === run ? { class: "chosen" } : {}));
    line.append(made("th", { scope: "row" }, one.name), made("td", { class: "n" }, `${one.evaluations}${one.budget ? ` of ${one.budget}` : ""}`));
    line.append(made("td", { class: "n" }, written(one.best_nrmse)), made("td", { class: "n" }, duration(one.seconds)));
    line.append(made("td", { class: "n" }, duration(one.seconds_left)), made("td", { class: "text" }, one.ending || (one.running ? "running" : "not running")));
  });
  at("runs").replaceChildren(head, body);
  if (at("run").options.length !== others.length)
    at("run").replaceChildren(...others.map((one, k) => made("option", { value: k }, one.name)));
  at("run").value = run;
}

const asked = async (path) => {
  const answer = await fetch(path), text = await answer.text();
  if (!answer.ok) throw new Error(JSON.parse(text).error);
  return text;
};

async function ask() {
  const number = run; // another run may be chosen meanwhile
  try {
    const text = await asked(`/state?run=${number}`), beside = at("run") ? await asked("/runs") : "[]";
    if (number === run && text + beside !== shown) {
      const state = JSON.parse(text);
      shown = text + beside;
      others = JSON.parse(beside);
      table.evaluations = new Map(state.points.map((one) => [one[3], one[0]]));
      table.best = state.best;
      header(state);
      if (at("run")) runs();
      curve(state);
      tree(state);
      const known = `${number} ${state.points.map((one) => one[3])} ${state.ending}`;
      if (known !== tried) {
        table.show(JSON.parse(await asked(`/trials?run=${number}`)));
        tried = known;
      }
      if (chosen === null && state.best !== null) choose(state.best);
    }
  } catch (error) {
    at("told").textContent = `no answer: ${error.message}`;
  }
}

async function always() {
  await ask();
  setTimeout(always, 2000);
}

at("run")?.addEventListener("change", () => {
  run = +at("run").value;
  chosen = null;
  shown = tried = "";
  ask();
});

at("stop").addEventListener("click", async () => {
  at("stop").disabled = true;
  const answer = await fetch(`/stop?run=${run}`, { method: "POST", headers: { "X-Ibrid-Token": TOKEN } });
  const told = await answer.json();
  at("stopped").textContent = answer.ok ? told.sentence : told.error;
  shown = "";
});

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
always();
