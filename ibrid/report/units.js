// The unit of a group of frequency responses: admittance or impedance, per unit, in decibels, or in S and ohm where the bases are known.

// data-base of a group is its base in S or in ohm; a hidden group that follows another is shown in its place.
for (const first of document.querySelectorAll(".four[data-quantity]:not([hidden])")) {
  const next = first.nextElementSibling, groups = next?.matches(".four[hidden]") ? [first, next] : [first];
  const choices = groups.flatMap((group) => {
    const { quantity, unit, base } = group.dataset;
    const own = [
      { words: `${quantity} in pu`, group, scale: null },
      { words: `${quantity} in dB`, group, scale: { factor: 1, decibel: true, unit: "dB" } },
    ];
    return base ? [...own, { words: `${quantity} in ${unit}`, group, scale: { factor: +base, decibel: false, unit } }] : own;
  });
  const bar = Object.assign(document.createElement("p"), { className: "unitbar" });
  const select = document.createElement("select"), label = bar.appendChild(document.createElement("label"));
  label.append("Shown: ", select);
  choices.forEach(({ words }, k) => select.append(Object.assign(document.createElement("option"), { value: k, textContent: words })));
  if (!first.dataset.base) {
    const why = Object.assign(document.createElement("span"), { className: "note" });
    why.textContent = " 0 dB is 1 pu; S and ohm need the bases of the measurement (s_base_va, v_base_v).";
    bar.append(why);
  }
  select.addEventListener("change", () => {
    const { group, scale } = choices[select.value];
    for (const plot of plots.filter((one) => groups.some((two) => two.contains(one.svg)))) plot.read(null);
    groups.forEach((one) => (one.hidden = one !== group));
    for (const plot of plots.filter((one) => group.contains(one.svg))) {
      plot.planes.forEach((plane) => plane.scale(scale));
      plot.draw();
    }
  });
  first.before(bar);
}
