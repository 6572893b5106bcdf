// Curves under the picture, all over one time axis with one cursor.

const ROUND = [1, 2, 5, 10];
function ticks(low, high, most) {
  const raw = (high - low) / most, ten = 10 ** Math.floor(Math.log10(raw)), step = ten * ROUND.find((m) => m * ten >= raw * 0.999);
  const found = [];
  for (let k = Math.ceil(low / step - 1e-9); k * step <= high + 1e-9 * step; k++) found.push(k * step);
  return found.length < 2 && most < 99 ? ticks(low, high, 2 * most) : found;  // one alone gives no scale
}
const tidy = (value) => Number.isFinite(value) ? String(Number(value.toPrecision(value >= 1000 ? 5 : 4))).replace("-", "−") : "–";

// Row of the last time not after t.
function rowAt(time, t) {
  let low = 0, high = time.length - 1;
  while (low < high) { const mid = (low + high + 1) >> 1; if (time[mid] <= t) low = mid; else high = mid - 1; }
  return low;
}

function makePlots(box, page, seek) {
  const time = page.motion.time, first = time[0], last = Math.max(time[time.length - 1], first + 1e-3);
  const range = { low: first, high: last };
  let now = last, hover = null, pulled = null;
  const css = (name) => getComputedStyle(document.documentElement).getPropertyValue(name).trim();
  const tone = (role) => css(role === "main" ? "--accent" : role === "asked" ? "--asked" : `--c${role}`);
  const plots = page.plots.map((plot) => {
    const figure = document.createElement("figure"), caption = document.createElement("figcaption"), canvas = document.createElement("canvas");
    caption.append(Object.assign(document.createElement("b"), { textContent: `${plot.title} [${plot.unit}]` }));
    const cells = plot.lines.map((line) => {
      const span = document.createElement("span"), swatch = document.createElement("i"), value = document.createElement("span");
      span.append(swatch, `${line.label} `, value);
      caption.append(span);
      return { swatch, value, line };
    });
    if (plot.note) caption.append(Object.assign(document.createElement("span"), { textContent: plot.note }));
    figure.append(caption, canvas);
    box.append(figure);
    return { plot, canvas, cells, still: document.createElement("canvas") };
  });
  const LEFT = 46, RIGHT = 8;
  const bottom = (index) => (index === plots.length - 1 ? 22 : 5);
  const across = (item, t) => LEFT + (item.wide - LEFT - RIGHT) * (t - range.low) / (range.high - range.low);
  const timeAt = (item, x) => Math.min(last, Math.max(first, range.low + (x - LEFT) / (item.wide - LEFT - RIGHT) * (range.high - range.low)));

  function limits(plot, from, to) {
    let low = Infinity, high = -Infinity;
    for (const line of plot.lines) for (const values of [line.values, line.low, line.high]) {
      if (values) for (let k = from; k <= to; k++) { if (values[k] < low) low = values[k]; if (values[k] > high) high = values[k]; }
    }
    if (!(low <= high)) [low, high] = [0, 1];
    if (low > 0 && low < 0.6 * high) low = 0;
    const pad = 0.06 * (high - low) || 0.5 * Math.abs(high) || 1;
    return [low === 0 ? 0 : low - pad, high + pad];
  }

  // What cannot be seen in a plot is shown as 0: rounding, at rest.
  for (const item of plots) { const [low, high] = limits(item.plot, 0, time.length - 1); item.slight = 1e-5 * (high - low); }

  // The parts of a plot that do not move with the cursor.
  function drawStill(item, index) {
    const { canvas, still, plot } = item, dense = window.devicePixelRatio || 1;
    item.wide = canvas.clientWidth;
    item.high = canvas.clientHeight;
    for (const each of [canvas, still]) { each.width = Math.round(item.wide * dense); each.height = Math.round(item.high * dense); }
    const pen = still.getContext("2d"), base = item.high - bottom(index);
    pen.scale(dense, dense);
    const from = Math.max(rowAt(time, range.low) - 1, 0), to = Math.min(rowAt(time, range.high) + 1, time.length - 1);
    const [low, high] = limits(plot, from, to), y = (v) => 4 + (base - 4) * (high - v) / (high - low), x = (k) => across(item, time[k]);
    pen.font = "11px system-ui, sans-serif";
    pen.fillStyle = css("--soft");
    pen.strokeStyle = css("--rule");
    pen.textBaseline = "middle";
    pen.textAlign = "right";
    for (const v of ticks(low, high, 3)) {
      pen.fillText(tidy(v), LEFT - 6, y(v));
      pen.beginPath(); pen.moveTo(LEFT, y(v)); pen.lineTo(item.wide - RIGHT, y(v)); pen.stroke();
    }
    if (index === plots.length - 1) {
      pen.textBaseline = "bottom";
      pen.textAlign = "center";
      for (const t of ticks(range.low, range.high, Math.max(3, item.wide / 110))) if (across(item, t) < item.wide - 24) pen.fillText(`${tidy(t)} s`, across(item, t), item.high - 2);
    }
    pen.save();
    pen.beginPath(); pen.rect(LEFT, 0, item.wide - LEFT - RIGHT, base); pen.clip();
    pen.lineJoin = "round";
    for (const { line, swatch } of item.cells) {
      const color = tone(line.role);
      swatch.style.background = color;
      if (line.low) {
        pen.fillStyle = css("--band");
        pen.beginPath();
        for (let k = from; k <= to; k++) pen.lineTo(x(k), y(line.high[k]));
        for (let k = to; k >= from; k--) pen.lineTo(x(k), y(line.low[k]));
        pen.fill();
      }
      pen.strokeStyle = color;
      pen.lineWidth = line.role === "asked" ? 1.1 : 1.4;
      pen.setLineDash(line.role === "asked" ? [6, 4] : []);
      pen.beginPath();
      let gap = true, column = -1, least = 0, most = 0;
      for (let k = from; k <= to; k++) {
        const v = line.values[k];
        if (!Number.isFinite(v)) { gap = true; continue; }
        // Of many rows in one pixel, the first, the least and the most.
        const here = Math.round(x(k) * dense);
        if (gap || here !== column) { if (gap) pen.moveTo(x(k), y(v)); else pen.lineTo(x(k), y(v)); column = here; least = most = v; gap = false; }
        else if (v < least || v > most) { pen.lineTo(x(k), y(v)); least = Math.min(least, v); most = Math.max(most, v); }
      }
      if (from === to) pen.arc(x(to), y(line.values[to]), 2.5, 0, 7);
      pen.stroke();
    }
    if (page.stop_time !== null) {
      pen.strokeStyle = css("--bad");
      pen.setLineDash([]);
      pen.beginPath(); pen.moveTo(across(item, page.stop_time), 0); pen.lineTo(across(item, page.stop_time), base); pen.stroke();
    }
    pen.restore();
  }

  function drawCursor(item, index) {
    const pen = item.canvas.getContext("2d"), dense = window.devicePixelRatio || 1;
    pen.setTransform(1, 0, 0, 1, 0, 0);
    pen.clearRect(0, 0, item.canvas.width, item.canvas.height);
    if (item.still.width) pen.drawImage(item.still, 0, 0);
    pen.scale(dense, dense);
    const stroke = (t, color, wide) => {
      if (t < range.low || t > range.high) return;
      pen.strokeStyle = color; pen.lineWidth = wide;
      pen.beginPath(); pen.moveTo(across(item, t), 0); pen.lineTo(across(item, t), item.high - bottom(index)); pen.stroke();
    };
    stroke(now, css("--ink"), 1.3);
    if (hover !== null) stroke(hover, css("--soft"), 1);
    if (pulled && Math.abs(pulled.to - pulled.from) > 0) {
      pen.fillStyle = css("--band");
      pen.fillRect(across(item, pulled.from), 0, across(item, pulled.to) - across(item, pulled.from), item.high - bottom(index));
    }
    const row = rowAt(time, hover ?? now);
    for (const { value, line } of item.cells) value.textContent = tidy(Math.abs(line.values[row]) < item.slight ? 0 : line.values[row]);
  }

  const draw = () => plots.forEach(drawCursor);
  const resize = () => { plots.forEach(drawStill); draw(); };
  for (const item of plots) {
    const place = (event) => timeAt(item, event.clientX - item.canvas.getBoundingClientRect().left);
    let from = 0;
    item.canvas.addEventListener("pointerdown", (event) => { from = event.clientX; pulled = { from: place(event), to: place(event) }; });
    item.canvas.addEventListener("pointermove", (event) => {
      hover = place(event);
      if (pulled && event.pointerType === "mouse") pulled.to = Math.abs(event.clientX - from) > 4 ? hover : pulled.from;
      draw();
    });
    item.canvas.addEventListener("pointerup", (event) => {
      if (pulled && pulled.to !== pulled.from) { [range.low, range.high] = [pulled.from, pulled.to].sort((a, b) => a - b); resize(); }
      else seek(place(event));
      pulled = null;
      draw();
    });
    for (const name of ["pointerleave", "pointercancel"]) item.canvas.addEventListener(name, () => { hover = pulled = null; draw(); });
    item.canvas.addEventListener("dblclick", () => { [range.low, range.high] = [first, last]; resize(); });
  }
  return { resize, move(t) { now = t; draw(); }, cursor: () => (plots.length ? across(plots[0], now) : NaN), range };
}
