"use strict";
// On a map a click, an arrow key or #cycle=MAP,X,Y in the address shows the stored cycle nearest to that place,
// and at first the one nearest to the operating point.

const SVG = "http://www.w3.org/2000/svg";
const ARROWS = { ArrowLeft: [-1, 0], ArrowRight: [1, 0], ArrowUp: [0, -1], ArrowDown: [0, 1] };
const KEY_STEP = 0.02;  // of the axes

function draw(parent, name, attributes) {
  const element = document.createElementNS(SVG, name);
  for (const [key, value] of Object.entries(attributes)) element.setAttribute(key, value);
  return parent.appendChild(element);
}

function add(parent, name, text) {
  const element = document.createElement(name);
  if (text !== undefined) element.textContent = text;
  return parent.appendChild(element);
}

function significant(value, digits = 5) {
  return String(Number(value.toPrecision(digits)));
}

function explore(root) {
  const data = JSON.parse(root.querySelector("script").textContent);
  const map = root.querySelector(".map"), overlay = map.querySelector("svg"), output = root.querySelector(".cycle");
  const { size, axes: [left, top, width, height], x: [x0, x1], y: [y0, y1] } = data.frame;
  const across = (x) => left + width * (x - x0) / (x1 - x0);
  const down = (y) => top + height * (y1 - y) / (y1 - y0);
  const places = data.cycles.map((cycle) => [across(cycle.x), down(cycle.y)]);
  let shown = -1, target = [left + width / 2, top + height / 2];

  data.cycles.forEach((cycle, place) => {
    const colour = cycle.unstable === 0 ? { fill: "#0072b2" } : { fill: "#ffffff", stroke: "#d55e00" };
    draw(overlay, "circle", { cx: places[place][0], cy: places[place][1], r: 1.8, ...colour });
  });
  const cross = draw(overlay, "path", { fill: "none", stroke: "#666666", "stroke-width": 0.7 });
  const ring = draw(overlay, "circle", { r: 6, fill: "none", stroke: "#cc0055", "stroke-width": 2, visibility: "hidden" });

  function nearest([u, v]) {
    let best = -1, least = Infinity;
    places.forEach(([a, b], place) => {
      const distance = (a - u) ** 2 + (b - v) ** 2;
      if (distance < least) [best, least] = [place, distance];
    });
    return best;
  }

  function aim(u, v) {
    target = [Math.min(Math.max(u, left), left + width), Math.min(Math.max(v, top), top + height)];
    cross.setAttribute("d", `M${target[0] - 9},${target[1]} h18 M${target[0]},${target[1] - 9} v18`);
    show(nearest(target));
  }

  function show(place) {
    if (place < 0) {
      output.textContent = "This map holds no stored cycle.";
      return;
    }
    shown = place;
    ring.setAttribute("cx", places[place][0]);
    ring.setAttribute("cy", places[place][1]);
    ring.setAttribute("visibility", "visible");
    describe(data.cycles[place], data.parameters, output, root.id);
  }

  if (data.operating_point) aim(across(data.operating_point[0]), down(data.operating_point[1]));
  map.addEventListener("click", (event) => {
    const box = overlay.getBoundingClientRect();
    aim((event.clientX - box.left) * size[0] / box.width, (event.clientY - box.top) * size[1] / box.height);
  });
  map.addEventListener("keydown", (event) => {
    const step = ARROWS[event.key];
    if (!step) return;
    event.preventDefault();
    aim(target[0] + KEY_STEP * width * step[0], target[1] + KEY_STEP * height * step[1]);
  });
  for (const button of root.querySelectorAll("button")) {
    button.addEventListener("click", () => {
      const count = data.cycles.length;
      if (!count) return show(-1);
      const next = shown < 0 ? 0 : (shown + Number(button.dataset.go) + count) % count;
      target = places[next];
      cross.removeAttribute("d");
      show(next);
    });
  }
  return { at: (x, y) => { aim(across(x), down(y)); map.scrollIntoView({ block: "center" }); } };
}

function describe(cycle, parameters, output, map) {
  output.replaceChildren();
  add(output, "h4", `Cycle ${cycle.row} of ${cycle.branch}`);
  const values = [cycle.x, cycle.y].map((value, place) => {
    const { title, factor, unit } = parameters[place];
    return `${title} ${significant(value)} (${significant(value * factor)} ${unit})`;
  });
  const many = cycle.unstable === 1 ? "multiplier" : "multipliers";
  const stability = cycle.unstable ? `unstable, ${cycle.unstable} ${many} outside the unit circle` : "stable";
  const period = cycle.turns === 1 ? "" : ` It lasts ${cycle.turns} excitation periods.`;
  const film = cycle.film.map((value) => value === null ? "not known" : significant(value)).join(", ");
  add(output, "p", `${values.join(", ")}: ${stability}.${period} Smallest film of each bearing, over its `
    + `clearance: ${film}. `);
  const link = add(output.lastChild, "a", "Link to this cycle");
  link.href = `#cycle=${map},${cycle.x},${cycle.y}`;
  const views = add(output, "div");
  views.className = "views";
  cycle.orbits.forEach((orbit, place) => drawOrbit(views, orbit, place + 1));
  if (!cycle.orbits.length) add(output, "p", "The store holds no orbit of this cycle.");
  drawMultipliers(views, cycle.multipliers);
  const list = cycle.multipliers.map(([re, im]) => {
    const angle = Math.atan2(im, re) * 180 / Math.PI;
    return `${significant(Math.hypot(re, im), 4)} at ${significant(angle, 4)}°`;
  });
  add(output, "p", `Floquet multipliers, modulus and argument: ${list.join("; ") || "none stored"}.`);
}

function view(parent, title, reach, middle = [0, 0]) {
  const figure = add(parent, "figure");
  const [u, v] = middle;
  const box = `${u - reach} ${-v - reach} ${2 * reach} ${2 * reach}`;
  const svg = draw(figure, "svg", { viewBox: box, role: "img", "aria-label": title });
  const thin = { "vector-effect": "non-scaling-stroke" };
  draw(svg, "path", { d: `M${u - reach},0 H${u + reach} M0,${-v - reach} V${-v + reach}`, class: "axis", ...thin });
  draw(svg, "circle", { r: 1, class: "guide", ...thin });
  add(figure, "figcaption", title);
  return { svg, thin };
}

function drawOrbit(parent, orbit, bearing) {
  const points = [];
  for (let place = 0; place < orbit.length; place += 2) points.push([orbit[place], orbit[place + 1]]);
  const path = `M${points.map(([x, y]) => `${x},${-y}`).join(" L")} Z`;
  const reach = Math.max(1.08, ...orbit.map((value) => 1.08 * Math.abs(value)));
  const whole = view(parent, `Orbit of journal ${bearing} in its clearance (dashed)`, reach);
  draw(whole.svg, "path", { d: path, class: "orbit", ...whole.thin });
  const middle = [0, 1].map((axis) => extremes(points, axis)).map(([low, high]) => (low + high) / 2);
  const half = Math.max(...[0, 1].map((axis) => extremes(points, axis)).map(([low, high]) => (high - low) / 2));
  const close = 1.15 * Math.max(half, 1e-4);
  const enlarged = view(parent, `Journal ${bearing} enlarged: ${significant(2 * close, 3)} clearances wide`, close, middle);
  draw(enlarged.svg, "path", { d: path, class: "orbit", ...enlarged.thin });
}

function extremes(points, axis) {
  const values = points.map((point) => point[axis]);
  return [Math.min(...values), Math.max(...values)];
}

function drawMultipliers(parent, multipliers) {
  const reach = Math.max(1.15, ...multipliers.map(([re, im]) => 1.1 * Math.hypot(re, im)));
  const { svg } = view(parent, "Floquet multipliers and the unit circle", reach);
  for (const [re, im] of multipliers) {
    const side = Math.hypot(re, im) > 1 ? "outside" : "inside";
    draw(svg, "circle", { cx: re, cy: -im, r: 0.025 * reach, class: side });
  }
}

function followAddress(maps) {
  const found = /^#cycle=([\w-]+),([^,]+),([^,]+)$/.exec(location.hash);
  if (found && maps.has(found[1])) maps.get(found[1]).at(Number(found[2]), Number(found[3]));
}

document.body.classList.add("scripted");
const maps = new Map([...document.querySelectorAll(".explorer")].map((root) => [root.id, explore(root)]));
addEventListener("hashchange", () => followAddress(maps));
addEventListener("beforeprint", () => document.querySelectorAll("details").forEach((part) => { part.open = true; }));
followAddress(maps);
