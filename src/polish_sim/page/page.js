// The page: data unpacked, time, what was removed up to then, and all that shows it.

async function unpack(text) {
  const packed = Uint8Array.from(atob(text), (letter) => letter.charCodeAt(0));
  const stream = new Blob([packed]).stream().pipeThrough(new DecompressionStream("deflate"));
  const bytes = new Uint8Array(await new Response(stream).arrayBuffer());
  const head = new DataView(bytes.buffer).getUint32(0, true), start = 4 + head;
  const array = ({ $: at, n, k, size, low, step }) => {
    const whole = size === 4 && step.every((s) => s === 1) && low.every((v) => v === 0);
    const out = whole ? new Uint32Array(n * k) : size === 4 ? new Float64Array(n * k) : new Float32Array(n * k);
    for (let c = 0; c < k; c++) {
      const plane = (b) => bytes.subarray(start + at + (b * k + c) * n, start + at + (b * k + c + 1) * n);
      const [b0, b1, b2, b3] = [0, 1, size === 4 ? 2 : 0, size === 4 ? 3 : 0].map(plane), base = low[c], unit_ = step[c];
      if (size === 2) for (let i = 0, level = 0; i < n; i++) {
        level = (level + (b0[i] | (b1[i] << 8))) & 65535;
        out[i * k + c] = level === 65535 ? NaN : base + unit_ * level;
      } else for (let i = 0, level = 0; i < n; i++) {
        level = (level + (b0[i] | (b1[i] << 8) | (b2[i] << 16) | (b3[i] << 24))) | 0;
        out[i * k + c] = whole ? level : base + unit_ * (level >>> 0);
      }
    }
    return out;
  };
  return JSON.parse(new TextDecoder().decode(bytes.subarray(4, start)), (_, value) => (value && value.$ !== undefined ? array(value) : value));
}

// ---- what the part has seen up to a moment, at each vertex of its map
const QUANTITIES = {
  removal: { name: "removal", unit: null, map: AROUND },
  coverage: { name: "coverage", unit: "1 = pad was here", map: VIRIDIS },
  dwell: { name: "time under the pad", unit: "s", map: VIRIDIS },
  pressure: { name: "mean pressure", unit: "kPa", map: VIRIDIS },
  error: { name: "force error, mean", unit: "N", map: VIRIDIS },
  curvature: { name: "curvature", unit: "1/m", map: AROUND },
};
const MARKS = 40;

function makeGrowth({ wear, motion, padOnPart }) {
  const { vertices, pad_radius: radius, spin } = wear, n = vertices.length / 3;
  const { low, high } = extent(vertices), cells = [0, 1, 2].map((c) => Math.floor((high[c] - low[c]) / radius) + 1);
  const cellOf = (p, k) => [0, 1, 2].map((c) => Math.floor((p[k + c] - low[c]) / radius));
  const first = new Uint32Array(cells[0] * cells[1] * cells[2] + 1), own = new Uint32Array(n), order = new Uint32Array(n);
  for (let v = 0; v < n; v++) {
    const [i, j, k] = cellOf(vertices, 3 * v);
    first[(own[v] = (i * cells[1] + j) * cells[2] + k) + 1]++;
  }
  for (let c = 1; c < first.length; c++) first[c] += first[c - 1];
  const next = first.slice();
  for (let v = 0; v < n; v++) order[next[own[v]]++] = v;
  const rows = motion.time.length;
  const gain = {
    removal: (r, d2, p) => p * Math.sqrt(motion.speed[r] ** 2 + spin * spin * d2),
    coverage: () => 1,
    dwell: () => 1,
    pressure: (r, d2, p) => p / 1000,
    error: (r) => Math.abs(motion.force[r] - motion.asked[r]) || 0,
    curvature: (r) => motion.curvature[r],
  };
  // Steps of the pad: first rows, each until it has gone on by a share of its radius.
  const steps = [0], away = (r, q) => Math.hypot(...[0, 1, 2].map((c) => padOnPart[3 * r + c] - padOnPart[3 * q + c]));
  for (let r = 1; r < rows - 1; r++) {
    const begun = steps[steps.length - 1];
    if ((motion.force[r] > 0.5) !== (motion.force[begun] > 0.5) || away(r, begun) > 0.03 * radius || motion.time[r] - motion.time[begun] > 0.25) steps.push(r);
  }
  const count = steps.length, every = Math.max(1, Math.ceil(count / MARKS));
  steps.push(rows - 1);
  let what = "", marks = [], sum = null, time = null;
  const out = new Float32Array(n);

  const areas = new Float32Array(n), hit = new Uint32Array(n), far = new Float32Array(n);
  for (let f = 0; f < wear.faces.length; f += 3) {
    const [a, b, c] = [0, 1, 2].map((k) => vertices.subarray(3 * wear.faces[f + k], 3 * wear.faces[f + k] + 3));
    const third = Math.hypot(...cross([b[0] - a[0], b[1] - a[1], b[2] - a[2]], [c[0] - a[0], c[1] - a[1], c[2] - a[2]])) / 6;
    for (let k = 0; k < 3; k++) areas[wear.faces[f + k]] += third;
  }

  // Adds some of the pad's steps; the force is spread over what of the part is under the pad.
  function add(from, to, share = 1) {
    const weigh = gain[what], least = radius * radius;
    for (let step = from; step < Math.min(to, count); step++) {
      const r = (steps[step] + steps[step + 1]) >> 1, c = cellOf(padOnPart, 3 * r);
      if (!(motion.force[r] > 0.5)) continue;
      const dt = (motion.time[steps[step + 1]] - motion.time[steps[step]]) * share;
      let hits = 0, under = 0;
      const x = padOnPart[3 * r], y = padOnPart[3 * r + 1], z = padOnPart[3 * r + 2];
      for (let i = Math.max(c[0] - 1, 0); i <= Math.min(c[0] + 1, cells[0] - 1); i++)
        for (let j = Math.max(c[1] - 1, 0); j <= Math.min(c[1] + 1, cells[1] - 1); j++)
          for (let k = Math.max(c[2] - 1, 0); k <= Math.min(c[2] + 1, cells[2] - 1); k++) {
            const cell = (i * cells[1] + j) * cells[2] + k;
            for (let m = first[cell]; m < first[cell + 1]; m++) {
              const v = order[m], dx = vertices[3 * v] - x, dy = vertices[3 * v + 1] - y, dz = vertices[3 * v + 2] - z;
              const d2 = dx * dx + dy * dy + dz * dz;
              if (d2 > least) continue;
              hit[hits] = v;
              far[hits++] = d2;
              under += areas[v];
            }
          }
      for (let h = 0; h < hits; h++) {
        sum[hit[h]] += dt * weigh(r, far[h], motion.force[r] / under);
        time[hit[h]] += dt;
      }
    }
  }
  function choose(name) {
    what = name;
    marks = [];
    sum = new Float32Array(n);
    time = new Float32Array(n);
    for (let step = 0; step < count; step += every) { marks.push([sum.slice(), time.slice()]); add(step, step + every); }
    marks.whole = [sum, time];
    if (name === "removal" && !wear.value.length) {
      let total = 0, area = 0;
      for (let v = 0; v < n; v++) { total += sum[v] * areas[v]; area += areas[v]; }
      wear.value = sum.map((v) => v * area / (total || 1));
    }
    const values = Array.from(upTo(rows - 1)).filter((v) => v > UNTOUCHED).sort((a, b) => a - b);
    const at_ = (share) => values[Math.floor(share * (values.length - 1))] ?? 0;
    const { map, name: label, unit } = QUANTITIES[name];
    const most = name === "curvature" ? Math.max(Math.abs(at_(0.02)), Math.abs(at_(0.98))) : name === "removal" ? wear.top : at_(0.98);
    return { map, label: name === "removal" ? wear.name : label, unit: unit ?? wear.unit, low: name === "curvature" ? -most : 0, high: most };
  }
  function upTo(row) {
    const whole = marks.whole;
    if (row >= rows - 1) [sum, time] = whole;
    else {
      const full = Math.min(rowAt(steps, row), count - 1), mark = Math.floor(full / every);
      [sum, time] = marks[mark].map((values) => values.slice());
      add(mark * every, full);
      add(full, full + 1, (row - steps[full]) / (steps[full + 1] - steps[full]));
    }
    for (let v = 0; v < n; v++) {
      if (what === "dwell") out[v] = time[v] > 0 ? time[v] : UNTOUCHED;
      else if (what !== "removal") out[v] = time[v] > 0 ? sum[v] / time[v] : UNTOUCHED;
      // The log's own map in the end; before, the share of it that the pad had done.
      else if (whole[0][v] > 0) out[v] = sum[v] > 0 ? wear.value[v] * Math.min(1, sum[v] / whole[0][v]) : UNTOUCHED;
      else out[v] = wear.value[v] > 0 && row >= rows - 1 ? wear.value[v] : UNTOUCHED;
    }
    [sum, time] = [null, null];
    return out;
  }
  return { choose, upTo };
}

// ---- everything together
const byId = (name) => document.getElementById(name);
const make = (tag, text = "", more = {}) => Object.assign(document.createElement(tag), { textContent: text }, more);

function showFacts(page) {
  byId("about").textContent = page.about;
  byId("stop").textContent = page.stop;
  byId("stop").hidden = !page.stop;
  const card = (title, ...content) => {
    const box = make("div");
    box.append(make("h2", title), ...content);
    byId("facts").append(box);
  };
  for (const [title, drawing] of Object.entries(page.charts)) card(title, make("figure", "", { innerHTML: drawing }));
  for (const [title, rows] of Object.entries(page.tables)) {
    const table = make("table");
    rows.forEach((row, index) => {
      const line = table.insertRow();
      for (const word of row) {
        const text = word.replace("not asked", "").replace(">= ", "≥\u00a0").replace("<= ", "≤\u00a0");
        line.append(make(index ? "td" : "th", text, { className: text === "yes" ? "yes" : text === "NO" ? "no" : "" }));
      }
    });
    card(title, table);
  }
  if (page.notes.length) {
    const list = make("ul");
    list.append(...page.notes.map((note) => make("li", note)));
    card("Notes", list);
  }
  if (page.command) card("Once more, from this folder", make("code", page.command), make("p", page.made));
}

async function start() {
  const begin = performance.now(), page = await unpack(byId("data").textContent);
  if (!page.motion.time.length) {
    document.body.classList.add("tables");
    showFacts(page);
    const dark = matchMedia("(prefers-color-scheme: dark)"), turn = (on) => { document.documentElement.dataset.theme = on ? "dark" : "light"; };
    byId("theme").addEventListener("click", () => turn(document.documentElement.dataset.theme !== "dark"));
    turn(dark.matches);
    window.page = { data: Object.assign(page, { ready: true, firstDrawing: performance.now() - begin }) };
    return;
  }
  const { motion } = page, rows = motion.time.length, width = motion.joints.length / rows;
  const first = motion.time[0], last = motion.time[rows - 1];
  const jointsAt = (row) => {
    const i = Math.min(Math.floor(row), rows - 1), j = Math.min(i + 1, rows - 1), f = row - i;
    return Array.from({ length: width }, (_, k) => (1 - f) * motion.joints[i * width + k] + f * motion.joints[j * width + k]);
  };
  const rowOf = (t) => {
    const i = rowAt(motion.time, t), span = i + 1 < rows ? motion.time[i + 1] - motion.time[i] : 1;
    return i + Math.min(1, Math.max(0, (t - motion.time[i]) / span));
  };
  const still = page.bodies.every((body, k) => k !== page.part_body || body.parent < 0);
  page.padOnPart = new Float32Array(3 * rows);
  for (let r = 0, T = null; r < rows; r++) {
    if (!T || !still) T = page.part_body < 0 ? WORLD : bodyPoses(page.bodies, jointsAt(r))[page.part_body];
    page.padOnPart.set(placeBack(T, motion.pad.subarray(3 * r, 3 * r + 3)), 3 * r);
  }
  for (const other of page.others) {
    other.padOnPart = new Float32Array(3 * rows);
    for (let r = 0, T = null; r < rows; r++) {
      if (!T || !still) T = page.part_body < 0 ? WORLD : bodyPoses(page.bodies, jointsAt(r))[page.part_body];
      other.padOnPart.set(placeBack(T, other.motion.pad.subarray(3 * r, 3 * r + 3)), 3 * r);
    }
  }
  page.pressing = motion.force.some((f) => f > 0);
  const drawn = bodyPoses(page.bodies, jointsAt(rows - 1)).map((T) => [T[3], T[7], T[11]]);
  page.cell = page.solids.some((solid) => solid.kind === "cell" || solid.body === 0 && solid.kind === "arm");
  const whole = extent(Float32Array.from([...drawn, [0, 0, 0]].flat()));
  page.center = whole.middle.map((v, k) => (k === 2 ? v + 0.05 : v));
  page.reach = Math.max(0.55 * whole.size, 0.45);
  showFacts(page);

  let now = last, playing = false, growth = null, colors = null, scale = null, asked = false, dirty = true, paints = 0;
  const scene = makeScene(byId("scene"), page, (t) => (t === undefined ? draw() : seek(t)));
  byId("no-gl").hidden = Boolean(scene);
  const plots = makePlots(byId("plots"), page, (t) => seek(t));
  byId("plots").hidden = !page.plots.length;
  const rgb = (name) => {
    const hex = getComputedStyle(document.documentElement).getPropertyValue(name).trim();
    return [1, 3, 5].map((k) => parseInt(hex.slice(k, k + 2), 16) / 255);
  };
  function paint() {
    asked = false;
    const row = rowOf(now), i = Math.floor(row), tip = motion.pad.subarray(3 * i, 3 * i + 3);
    scene?.move(jointsAt(row), Array.from(tip), i);
    if (scale && dirty) scene.color((page.colored = colors(row)), scale);
    dirty = false;
    scene?.paint({ sky: rgb("--sky"), floor: rgb("--floor"), runs: [0, 1, 2, 3, 4, 5].map((k) => rgb(`--c${k}`)) });
    plots.move(now);
    byId("scrubber").value = now;
    byId("clock").textContent = `${(now - first).toFixed(last - first < 20 ? 2 : 1)} / ${(last - first).toFixed(1)} s`;
    const said = [page.pressing ? `${motion.force[i].toFixed(2)} N` : "", Number.isFinite(motion.speed[i]) ? `${(1e3 * motion.speed[i]).toFixed(2)} mm/s` : ""];
    byId("readout").textContent = said.filter(Boolean).join(" · ");
    if (!paints++) page.firstDrawing = performance.now() - begin;
  }
  function draw() { if (!asked) { asked = true; requestAnimationFrame(paint); } }
  function seek(t) { now = Math.min(last, Math.max(first, t)); dirty = true; draw(); }

  // ---- what is shown
  function legend() {
    const box = byId("legend");
    box.replaceChildren();
    for (const each of [scale, page.traceScale]) {
      if (!each) continue;
      const ends = make("div", "", { className: "ends" }), bar = make("div", "", { className: "bar" });
      ends.append(make("span", tidy(each.low)), make("span", `${each.label}, ${each.unit}`), make("span", tidy(each.high)));
      bar.style.background = cssMap(each.map);
      box.append(bar, ends);
    }
  }
  const select = (label, options, choose) => {
    const box = make("label", `${label} `), list = make("select");
    for (const [value, name] of options) list.append(make("option", name, { value }));
    list.addEventListener("change", () => choose(list.value));
    box.append(list);
    byId("layers").append(box);
  };
  const traces = { plain: null, force: ["force", "N", (k) => motion.force[k]], speed: ["speed", "mm/s", (k) => 1e3 * motion.speed[k]],
    error: ["error across the tool", "µm", (k) => 1e6 * motion.error[k]] };
  const grown = (number) => {
    const other = page.others[number];
    return (other.growth ??= makeGrowth({ wear: { ...page.wear, value: other.value }, motion: other.motion, padOnPart: other.padOnPart }));
  };
  function colorPart(name) {
    const [key, number] = name.split(":"), other = number && grown(Number(number));
    colors = (row) => growth.upTo(row);
    scale = name === "plain" ? null : other ? other.choose("removal") : growth.choose(name);
    if (other) scale.label = `${page.others[number].name}: removal`;
    if (other) colors = (row) => other.upTo(row);
    if (key === "minus") {
      growth.choose("removal");
      const both = new Float32Array(page.wear.vertices.length / 3);
      colors = (row) => {
        const here = growth.upTo(row), there = other.upTo(row);
        return both.map((_, v) => (here[v] > UNTOUCHED || there[v] > UNTOUCHED ? Math.max(there[v], 0) - Math.max(here[v], 0) : UNTOUCHED));
      };
      const sizes = Array.from(colors(rows - 1)).filter((v) => v > UNTOUCHED).map(Math.abs).sort((a, b) => a - b);
      const most = sizes[Math.floor(0.98 * (sizes.length - 1))] || 1;
      scale = { map: AROUND, label: `${page.others[number].name} − ${page.name}`, unit: scale.unit, low: -most, high: most };
    }
    if (!scale) scene.color(new Float32Array(page.wear.vertices.length / 3).fill(UNTOUCHED), { map: VIRIDIS, low: 0, high: 1 });
    dirty = true;
    legend();
    draw();
  }
  function colorTrace(name) {
    const chosen = traces[name], values = chosen && Float32Array.from({ length: rows }, (_, k) => chosen[2](k));
    const sorted = values && Array.from(values).filter((_, k) => !page.pressing || motion.force[k] > 0).sort((a, b) => a - b);
    page.traceScale = values && { map: VIRIDIS, label: chosen[0], unit: chosen[1], low: sorted[Math.floor(0.01 * sorted.length)], high: sorted[Math.floor(0.99 * sorted.length)] };
    scene.colorTrace(values, page.traceScale);
    legend();
    draw();
  }
  if (scene) {
    if (page.wear) {
      growth = makeGrowth(page);
      const known = Object.entries(QUANTITIES).filter(([key]) => key !== "error" || page.wear.name === "removal");
      const laid = page.others.flatMap(({ name, value }, k) => (value.length ? [[`minus:${k}`, `removal: ${name} − ${page.name}`], [`only:${k}`, `removal: ${name}`]] : []));
      select("part", [...known.map(([key, q]) => [key, q.name]), ...laid, ["plain", "plain"]], colorPart);
    }
    select("trace", [["plain", "plain"], ["force", "force"], ["speed", "speed"], ["error", "error"]].filter(([key]) => (key !== "force" || page.pressing) && (key !== "error" || motion.error.some((v) => v > 0))), colorTrace);
    const usual = ["cell", "part"], marks = new Map(page.solids.filter((solid) => !usual.includes(solid.kind)).map((solid) => [solid.kind, solid.color]));
    for (const name of new Set([...marks.keys(), "path", "trace"])) {
      const box = make("label"), check = Object.assign(make("input"), { type: "checkbox", checked: true });
      check.addEventListener("input", () => { scene.shown[name] = check.checked; draw(); });
      box.append(check, ` ${name === "arm" && !page.cell ? "tool" : name}`);
      if (name.includes(" ")) box.style.color = `rgb(${marks.get(name).map((v) => Math.round(210 * v)).join(",")})`;
      byId("layers").append(box);
    }
  }
  document.querySelector("[data-view=part]").hidden = page.part_body < 0;
  document.querySelector("[data-view=cell]").hidden = !page.cell;
  const look = (name) => {
    scene?.look(name);
    for (const button of document.querySelectorAll("#views button")) button.setAttribute("aria-pressed", String(button.dataset.view === name));
  };
  for (const button of document.querySelectorAll("#views button")) button.addEventListener("click", () => look(button.dataset.view));

  // ---- time
  const speeds = [0.1, 0.25, 0.5, 1, 2, 4, 8, 16, 32, 64], fit = (last - first) / 30;
  const list = byId("speed");
  for (const speed of speeds) list.append(make("option", `× ${speed}`, { value: speed, selected: speed === (speeds.find((s) => s >= fit) ?? 64) }));
  if (fit <= 1) list.value = "1";
  let before = 0;
  function run(t) {
    if (!playing) return;
    seek(now + Number(list.value) * (t - before) / 1000);
    before = t;
    if (now >= last) play(false); else requestAnimationFrame(run);
  }
  function play(on) {
    playing = on && rows > 1;
    byId("play").textContent = playing ? "⏸" : "▶";
    if (!playing) return;
    if (now >= last) seek(first);
    before = performance.now();
    requestAnimationFrame(run);
  }
  Object.assign(byId("scrubber"), { min: first, max: last, value: now });
  byId("scrubber").addEventListener("input", (event) => seek(Number(event.target.value)));
  byId("play").addEventListener("click", () => play(!playing));
  const step = (last - first) / 400, next = (by) => { list.selectedIndex = Math.min(speeds.length - 1, Math.max(0, list.selectedIndex + by)); };
  const keys = { " ": () => play(!playing), ArrowLeft: (far) => seek(now - step * far), ArrowRight: (far) => seek(now + step * far),
    Home: () => seek(first), End: () => seek(last), "+": () => next(1), "-": () => next(-1), 1: () => look("cell"), 2: () => look("part"),
    3: () => look("tool"), d: () => turnTheme() };
  window.addEventListener("keydown", (event) => {
    if (event.ctrlKey || event.metaKey || event.altKey || !keys[event.key] || event.target.tagName === "SELECT") return;
    event.preventDefault();
    if (event.target.tagName === "BUTTON") event.target.blur();
    keys[event.key](event.shiftKey ? 10 : 1);
  });

  // ---- light and dark, sizes, paper
  const dark = matchMedia("(prefers-color-scheme: dark)");
  const theme = (name) => { document.documentElement.dataset.theme = name; plots.resize(); draw(); };
  const turnTheme = () => theme(document.documentElement.dataset.theme === "dark" ? "light" : "dark");
  byId("theme").addEventListener("click", turnTheme);
  dark.addEventListener("change", () => theme(dark.matches ? "dark" : "light"));
  window.addEventListener("beforeprint", () => { theme("light"); paint(); });
  window.addEventListener("resize", () => { plots.resize(); draw(); });
  theme(dark.matches ? "dark" : "light");
  look(page.view);
  // What has been removed is worked out after the first drawing.
  requestAnimationFrame(() => setTimeout(() => { if (growth) colorPart("removal"); page.ready = true; }));
  window.page = { data: page, seek, play, look, now: () => now, cursor: plots.cursor,
    bodies: (t) => bodyPoses(page.bodies, jointsAt(rowOf(t))), joints: (t) => jointsAt(rowOf(t)),
    removal: (t) => Array.from(growth.choose("removal") && growth.upTo(rowOf(t)), (v) => (v > UNTOUCHED ? v : 0)) };
}
start();
