"use strict";
// The cell in 3D: bodies, solids, the part's colours, path and trace. Lengths in m; poses are 3 x 4, by rows.

const mul = (A, B) => {
  const C = new Float64Array(12);
  for (let r = 0; r < 12; r += 4) for (let c = 0; c < 4; c++)
    C[r + c] = A[r] * B[c] + A[r + 1] * B[4 + c] + A[r + 2] * B[8 + c] + (c === 3 ? A[r + 3] : 0);
  return C;
};
const place = (T, p) => [0, 4, 8].map((r) => T[r] * p[0] + T[r + 1] * p[1] + T[r + 2] * p[2] + T[r + 3]);
const placeBack = (T, p) => {
  const d = [p[0] - T[3], p[1] - T[7], p[2] - T[11]];
  return [0, 1, 2].map((c) => T[c] * d[0] + T[4 + c] * d[1] + T[8 + c] * d[2]);
};
const WORLD = Float64Array.of(1, 0, 0, 0, 0, 1, 0, 0, 0, 0, 1, 0);
const dot = (a, b) => a[0] * b[0] + a[1] * b[1] + a[2] * b[2];
const cross = (a, b) => [a[1] * b[2] - a[2] * b[1], a[2] * b[0] - a[0] * b[2], a[0] * b[1] - a[1] * b[0]];
const unit = (a) => { const n = Math.hypot(...a) || 1; return a.map((v) => v / n); };

function jointPose(body, value) {
  const [x, y, z] = body.axis;
  if (body.slide) return Float64Array.of(1, 0, 0, x * value, 0, 1, 0, y * value, 0, 0, 1, z * value);
  const c = Math.cos(value), s = Math.sin(value), k = 1 - c;
  const R = Float64Array.of(c + k * x * x, k * x * y - s * z, k * x * z + s * y, 0, k * x * y + s * z, c + k * y * y,
    k * y * z - s * x, 0, k * x * z - s * y, k * y * z + s * x, c + k * z * z, 0);
  const turned = place(R, body.anchor);
  for (let r = 0; r < 3; r++) R[4 * r + 3] = body.anchor[r] - turned[r];
  return R;
}

// Poses of all bodies in the world.
function bodyPoses(bodies, joints) {
  const poses = [];
  for (const body of bodies) {
    body.fixed ??= Float64Array.from(body.rest.slice(0, 3).flat());
    const own = body.joint < 0 ? body.fixed : mul(body.fixed, jointPose(body, joints[body.joint]));
    poses.push(body.parent < 0 ? own : mul(poses[body.parent], own));
  }
  return poses;
}

// ---- colours: sixteen steps of a map
const VIRIDIS = [[68, 1, 84], [72, 40, 120], [62, 74, 137], [49, 104, 142], [38, 130, 142], [31, 158, 137], [53, 183, 121],
  [109, 205, 89], [180, 222, 44], [253, 231, 37]];
const AROUND = [[49, 54, 149], [69, 117, 180], [116, 173, 209], [171, 217, 233], [224, 243, 248], [255, 255, 191], [254, 224, 144],
  [253, 174, 97], [244, 109, 67], [215, 48, 39], [165, 0, 38]];
const steps16 = (map) => [...Array(16).keys()].map((k) => {
  const at = (k / 15) * (map.length - 1), i = Math.min(Math.floor(at), map.length - 2);
  return map[i].map((v, c) => (v + (at - i) * (map[i + 1][c] - v)) / 255);
});
const cssMap = (map) => `linear-gradient(to right, ${map.map((c) => `rgb(${c.join(",")})`).join(",")})`;
const UNTOUCHED = -1e9;

// ---- shaders
const LIT = `
vec3 lit(vec3 tint, vec3 eye, vec3 normal) {
  vec3 n = normalize(normal); if (dot(n, eye) > 0.0) n = -n;
  float key = max(dot(n, normalize(vec3(-0.45, 0.65, 0.62))), 0.0), fill = max(dot(n, normalize(vec3(0.7, -0.1, 0.5))), 0.0);
  vec3 half_ = normalize(normalize(vec3(-0.45, 0.65, 0.62)) - normalize(eye));
  return tint * (0.36 + 0.62 * key + 0.16 * fill) + 0.12 * pow(max(dot(n, half_), 0.0), 40.0);
}`;
const SCALE = `
uniform vec3 colors[16]; uniform vec2 range;
vec3 mapped(float value) {
  float at = clamp((value - range.x) / (range.y - range.x), 0.0, 1.0) * 15.0; int k = int(min(floor(at), 14.0));
  return mix(colors[k], colors[k + 1], at - float(k));
}`;
const HEAD = "#version 300 es\nprecision highp float; uniform mat4 view, projection;";
const PROGRAMS = {
  solid: [`${HEAD} in vec3 position, normal; uniform mat4 pose; uniform float lift; out vec3 eye, way, at;
void main() { vec4 w = pose * vec4(position, 1.0); vec4 seen = view * w; at = w.xyz; eye = seen.xyz; seen.z += lift;
  way = mat3(view) * mat3(pose) * normal; gl_Position = projection * seen; }`,
  `${HEAD} in vec3 eye, way, at; uniform vec3 tint; uniform float floor_; uniform vec3 sky; out vec4 pixel; ${LIT}
void main() { if (floor_ > 0.0) { vec2 g = abs(fract(at.xy / 0.25) - 0.5); vec2 w = fwidth(at.xy / 0.25);
    float line = 1.0 - smoothstep(0.0, 1.5, min((0.5 - g.x) / w.x, (0.5 - g.y) / w.y));
    pixel = vec4(mix(mix(tint, sky, 0.35 * line), sky, smoothstep(0.5, 1.9, length(at.xy - vec2(0.0, -0.3)))), 1.0); }
  else pixel = vec4(lit(tint, eye, way), 1.0); }`],
  map: [`${HEAD} in vec3 position, normal; in float value; uniform mat4 pose; uniform float lift; out vec3 eye, way; out float v;
void main() { vec4 seen = view * pose * vec4(position, 1.0); eye = seen.xyz; way = mat3(view) * mat3(pose) * normal; v = value;
  seen.z += lift; gl_Position = projection * seen; }`,
  `${HEAD} in vec3 eye, way; in float v; uniform vec3 tint; out vec4 pixel; ${SCALE} ${LIT}
void main() { pixel = vec4(lit(v < -1e8 ? tint : mapped(v), eye, way), 1.0); }`],
  line: [`${HEAD} in vec3 a, b; in float va, vb; in vec2 corner; uniform mat4 pose; uniform float lift, wide; uniform vec2 size; out float v;
void main() { vec4 p = view * pose * vec4(a, 1.0), q = view * pose * vec4(b, 1.0); p.z += lift; q.z += lift;
  vec4 c = projection * p, d = projection * q; vec2 along = (d.xy / d.w - c.xy / c.w) * size; float n = length(along);
  along = n > 1e-6 ? along / n : vec2(1.0, 0.0);
  vec4 end = corner.x > 0.5 ? d : c; v = corner.x > 0.5 ? vb : va;
  end.xy += (vec2(-along.y, along.x) * corner.y + along * (corner.x - 0.5)) * wide / size * end.w; gl_Position = end; }`,
  `${HEAD} in float v; uniform vec3 tint; uniform float plain; out vec4 pixel; ${SCALE}
void main() { pixel = vec4(plain > 0.5 ? tint : mapped(v), 1.0); }`],
};

function compile(gl, [vertex, fragment]) {
  const program = gl.createProgram();
  for (const [kind, source] of [[gl.VERTEX_SHADER, vertex], [gl.FRAGMENT_SHADER, fragment]]) {
    const shader = gl.createShader(kind);
    gl.shaderSource(shader, source);
    gl.compileShader(shader);
    if (!gl.getShaderParameter(shader, gl.COMPILE_STATUS)) throw new Error(gl.getShaderInfoLog(shader));
    gl.attachShader(program, shader);
  }
  gl.linkProgram(program);
  if (!gl.getProgramParameter(program, gl.LINK_STATUS)) throw new Error(gl.getProgramInfoLog(program));
  const places = {};
  return { program, at: (name) => (places[name] ??= gl.getUniformLocation(program, name)) };
}

// Corners with normals of their own: smooth but at edges sharper than 35 degrees.
function withNormals(vertices, faces) {
  const count = faces.length / 3, own = new Float32Array(3 * count), big = new Float32Array(3 * count);
  const first = new Uint32Array(vertices.length / 3 + 1), around = new Uint32Array(faces.length);
  for (let f = 0; f < count; f++) {
    const [i, j, k] = [3 * faces[3 * f], 3 * faces[3 * f + 1], 3 * faces[3 * f + 2]];
    const ux = vertices[j] - vertices[i], uy = vertices[j + 1] - vertices[i + 1], uz = vertices[j + 2] - vertices[i + 2];
    const wx = vertices[k] - vertices[i], wy = vertices[k + 1] - vertices[i + 1], wz = vertices[k + 2] - vertices[i + 2];
    const n = [uy * wz - uz * wy, uz * wx - ux * wz, ux * wy - uy * wx], long = Math.hypot(...n) || 1;
    for (let c = 0; c < 3; c++) { big[3 * f + c] = n[c]; own[3 * f + c] = n[c] / long; first[faces[3 * f + c] + 1]++; }
  }
  for (let v = 1; v < first.length; v++) first[v] += first[v - 1];
  const next = first.slice();
  for (let k = 0; k < faces.length; k++) around[next[faces[k]]++] = Math.floor(k / 3);
  const points = new Float32Array(3 * faces.length), normals = new Float32Array(3 * faces.length);
  for (let k = 0; k < faces.length; k++) {
    const v = faces[k], f = 3 * Math.floor(k / 3);
    for (let m = first[v]; m < first[v + 1]; m++) {
      const g = 3 * around[m];
      if (own[f] * own[g] + own[f + 1] * own[g + 1] + own[f + 2] * own[g + 2] < 0.82) continue;
      for (let c = 0; c < 3; c++) normals[3 * k + c] += big[g + c];
    }
    for (let c = 0; c < 3; c++) points[3 * k + c] = vertices[3 * v + c];
  }
  return { points, normals };
}

const extent = (points) => {
  const low = [1e9, 1e9, 1e9], high = [-1e9, -1e9, -1e9];
  for (let k = 0; k < points.length; k++) { low[k % 3] = Math.min(low[k % 3], points[k]); high[k % 3] = Math.max(high[k % 3], points[k]); }
  return { low, high, middle: low.map((v, c) => 0.5 * (v + high[c])), size: Math.hypot(...low.map((v, c) => high[c] - v)) };
};

function makeScene(canvas, page, changed) {
  const gl = canvas.getContext("webgl2", { antialias: true, preserveDrawingBuffer: true });
  if (!gl) return null;
  const programs = Object.fromEntries(Object.entries(PROGRAMS).map(([name, sources]) => [name, compile(gl, sources)]));
  const upload = (program, name, values, width, divisor = 0, offset = 0, buffer = gl.createBuffer()) => {
    const at = gl.getAttribLocation(programs[program].program, name);
    gl.bindBuffer(gl.ARRAY_BUFFER, buffer);
    if (values) gl.bufferData(gl.ARRAY_BUFFER, values, gl.DYNAMIC_DRAW);
    gl.enableVertexAttribArray(at);
    gl.vertexAttribPointer(at, width, gl.FLOAT, false, 0, offset);
    gl.vertexAttribDivisor(at, divisor);
    return buffer;
  };
  const mesh = (vertices, faces) => {
    const { points, normals } = withNormals(vertices, faces), array = gl.createVertexArray();
    gl.bindVertexArray(array);
    upload("solid", "position", points, 3);
    upload("solid", "normal", normals, 3);
    return { array, count: faces.length };
  };
  const solids = page.solids.map((solid) => ({ ...solid, ...mesh(solid.vertices, solid.faces) }));
  const floor = mesh(Float32Array.of(-4, -4, -0.75, 4, -4, -0.75, 4, 4, -0.75, -4, 4, -0.75), Uint32Array.of(0, 1, 2, 0, 2, 3));
  const thick = (points, values) => {
    const array = gl.createVertexArray(), count = points.length / 3 - 1;
    gl.bindVertexArray(array);
    upload("line", "corner", Float32Array.of(0, -1, 1, -1, 0, 1, 1, 1), 2);
    upload("line", "b", null, 3, 1, 12, upload("line", "a", points, 3, 1));
    const tinted = upload("line", "va", values, 1, 1);
    upload("line", "vb", null, 1, 1, 4, tinted);
    return { array, count, tinted };
  };
  const trace = thick(page.padOnPart, new Float32Array(page.padOnPart.length / 3));
  const others = page.others.map(({ padOnPart }) => thick(padOnPart, new Float32Array(padOnPart.length / 3)));
  const path = page.path.length > 3 ? thick(page.path, page.contact) : null;
  let map = null, facing = [0, 0, 1e-12];  // where the polished region looks, in the part's frame
  if (page.wear) {
    const { vertices, faces } = page.wear, normals = new Float32Array(vertices.length);
    for (let f = 0; f < faces.length; f += 3) {
      const [a, b, c] = [0, 1, 2].map((k) => vertices.subarray(3 * faces[f + k], 3 * faces[f + k] + 3));
      const n = cross([b[0] - a[0], b[1] - a[1], b[2] - a[2]], [c[0] - a[0], c[1] - a[1], c[2] - a[2]]);
      for (let k = 0; k < 3; k++) for (let x = 0; x < 3; x++) normals[3 * faces[f + k] + x] += n[x];
      facing = facing.map((v, x) => v + n[x]);
    }
    map = { array: gl.createVertexArray(), count: faces.length };
    gl.bindVertexArray(map.array);
    upload("map", "position", vertices, 3);
    upload("map", "normal", normals, 3);
    map.values = upload("map", "value", new Float32Array(vertices.length / 3), 1);
    gl.bindBuffer(gl.ELEMENT_ARRAY_BUFFER, gl.createBuffer());
    gl.bufferData(gl.ELEMENT_ARRAY_BUFFER, faces, gl.STATIC_DRAW);
  }

  // ---- camera: turns about the world's z
  const parts = solids.filter((solid) => solid.kind === "part").map((solid) => extent(solid.vertices));
  const work = parts[0] ?? extent(page.path.length ? page.path : page.padOnPart);
  const camera = { turn: -0.95, rise: 0.42, far: 2.0, at: [0, 0, 0], follow: "" };
  const shown = { path: true, trace: true };
  let poses = [], tool = [0, 0, 0], tint = null;
  function look(name) {
    camera.follow = name;
    Object.assign(camera, { rise: name === "cell" ? 0.42 : 0.75, turn: -0.95, far: { cell: 3.4 * page.reach, part: 2.0 * Math.max(work.size, 0.08), tool: 0.55 }[name] });
    const T = poses[page.part_body] ?? WORLD, way = [0, 4, 8].map((r) => dot([T[r], T[r + 1], T[r + 2]], facing));
    const level = Math.hypot(way[0], way[1]);
    // A region on the part's side is looked at from that side.
    if (name === "part" && level > 0.7 * Math.hypot(...way)) Object.assign(camera, { rise: 0.5, turn: Math.atan2(way[1], way[0]) - 0.7 });
    aim();
  }
  function aim() {
    const body = poses[page.part_body] ?? WORLD;
    if (camera.follow === "tool") camera.at = tool;
    else if (camera.follow === "part") camera.at = place(body, work.middle);
    else if (camera.follow === "cell") camera.at = page.center;
  }
  function frame() {
    const level = [Math.cos(camera.turn), Math.sin(camera.turn), 0], c = Math.cos(camera.rise), s = Math.sin(camera.rise);
    const to = [c * level[0], c * level[1], s], side = [-level[1], level[0], 0];
    return { to, side, above: cross(to, side), eye: camera.at.map((v, k) => v + camera.far * to[k]) };
  }
  function matrices() {
    const { to, side, above, eye } = frame(), f = 1 / Math.tan(0.3), near = 0.03 * camera.far, far = camera.far + 8;
    // A narrow picture shows as much across as a square one.
    const wide = canvas.width / Math.max(canvas.height, 1), zoom = f * Math.min(1, wide);
    const view = Float32Array.of(side[0], above[0], to[0], 0, side[1], above[1], to[1], 0, side[2], above[2], to[2], 0,
      -dot(side, eye), -dot(above, eye), -dot(to, eye), 1);
    const projection = Float32Array.of(zoom / wide, 0, 0, 0, 0, zoom, 0, 0, 0, 0, (far + near) / (near - far), -1,
      0, 0, 2 * far * near / (near - far), 0);
    return { view, projection };
  }
  const columns = (T) => Float32Array.of(T[0], T[4], T[8], 0, T[1], T[5], T[9], 0, T[2], T[6], T[10], 0, T[3], T[7], T[11], 1);

  function use(name, matrix, T) {
    const { program, at } = programs[name];
    gl.useProgram(program);
    gl.uniformMatrix4fv(at("view"), false, matrix.view);
    gl.uniformMatrix4fv(at("projection"), false, matrix.projection);
    if (T) gl.uniformMatrix4fv(at("pose"), false, columns(T));
    return at;
  }
  const scaled = (at, scale) => {
    gl.uniform3fv(at("colors"), steps16(scale.map).flat());
    gl.uniform2f(at("range"), scale.low, scale.high > scale.low ? scale.high : scale.low + 1);
  };
  const pose = (body) => (body < 0 ? WORLD : poses[body]);

  function paint(theme) {
    const dense = window.devicePixelRatio || 1;
    const [w, h] = [Math.round(canvas.clientWidth * dense), Math.round(canvas.clientHeight * dense)];
    if (canvas.width !== w || canvas.height !== h) { canvas.width = w; canvas.height = h; }
    gl.viewport(0, 0, w, h);
    gl.clearColor(...theme.sky, 1);
    gl.clear(gl.COLOR_BUFFER_BIT | gl.DEPTH_BUFFER_BIT);
    gl.enable(gl.DEPTH_TEST);
    const matrix = matrices(), part = pose(page.part_body);
    let at = use("solid", matrix, WORLD);
    gl.uniform3fv(at("sky"), theme.sky);
    gl.uniform1f(at("floor_"), 1);
    gl.uniform3fv(at("tint"), theme.floor);
    gl.uniform1f(at("lift"), 0);
    gl.bindVertexArray(floor.array);
    if (page.cell) gl.drawArrays(gl.TRIANGLES, 0, floor.count);
    gl.uniform1f(at("floor_"), 0);
    const lift = 0.0015 * camera.far;
    for (const solid of solids) {
      if (shown[solid.kind] === false) continue;
      gl.uniform1f(at("lift"), solid.kind.includes(" ") ? 1.5 * lift : 0);
      gl.uniformMatrix4fv(at("pose"), false, columns(pose(solid.body)));
      gl.uniform3fv(at("tint"), solid.color);
      gl.bindVertexArray(solid.array);
      gl.drawArrays(gl.TRIANGLES, 0, solid.count);
    }
    if (map && tint) {
      at = use("map", matrix, part);
      gl.uniform1f(at("lift"), lift);
      gl.uniform3fv(at("tint"), [0.72, 0.74, 0.78]);
      scaled(at, tint);
      gl.bindVertexArray(map.array);
      gl.drawElements(gl.TRIANGLES, map.count, gl.UNSIGNED_INT, 0);
    }
    at = use("line", matrix, part);
    gl.uniform2f(at("size"), w, h);
    const strip = (line, count, wide, color, nearer, scale) => {
      gl.uniform1f(at("wide"), wide * dense);
      gl.uniform1f(at("lift"), nearer);
      gl.uniform1f(at("plain"), scale ? 0 : 1);
      if (color) gl.uniform3fv(at("tint"), color);
      if (scale) scaled(at, scale);
      gl.bindVertexArray(line.array);
      gl.drawArraysInstanced(gl.TRIANGLE_STRIP, 0, 4, count);
    };
    if (path && shown.path) strip(path, path.count, 0.8, null, 2 * lift, { map: [[230, 120, 20], [107, 117, 133]], low: 0, high: 1 });
    if (!shown.trace || trace.row < 1) return;
    strip(trace, Math.min(trace.row, trace.count), 1.7, others.length ? theme.runs[0] : [0.09, 0.1, 0.14], 3 * lift, trace.scale);
    others.forEach((other, k) => strip(other, Math.min(trace.row, other.count), 1.7, theme.runs[(k + 1) % 6], 3.2 * lift));
  }

  // The row of the trace nearest to a place of the canvas, or -1.
  function pick(x, y) {
    const { view, projection } = matrices(), T = pose(page.part_body), points = page.padOnPart;
    let best = -1, least = 24 ** 2, depth = 1e9;
    for (let k = 0; k < points.length / 3; k++) {
      if (page.pressing && !(page.motion.force[k] > 0)) continue;
      const p = place(T, points.subarray(3 * k, 3 * k + 3));
      const seen = [0, 1, 2].map((r) => view[r] * p[0] + view[4 + r] * p[1] + view[8 + r] * p[2] + view[12 + r]);
      const px = (0.5 - 0.5 * projection[0] * seen[0] / seen[2]) * canvas.clientWidth;
      const py = (0.5 + 0.5 * projection[5] * seen[1] / seen[2]) * canvas.clientHeight;
      const far = (px - x) ** 2 + (py - y) ** 2;
      if (far > 24 ** 2 || (far > least + 9 && -seen[2] > depth - 0.02)) continue;
      if (far < least || -seen[2] < depth - 0.02) { best = k; least = far; depth = -seen[2]; }
    }
    return best;
  }

  // ---- hands
  const held = new Map();
  let moved = 0;
  const apart = () => { const [a, b] = [...held.values()]; return Math.hypot(a.x - b.x, a.y - b.y); };
  canvas.addEventListener("pointerdown", (event) => {
    canvas.setPointerCapture(event.pointerId);
    held.set(event.pointerId, { x: event.clientX, y: event.clientY });
    moved = held.size > 1 ? 99 : 0;
  });
  canvas.addEventListener("pointercancel", (event) => held.delete(event.pointerId));
  canvas.addEventListener("pointerup", (event) => {
    held.delete(event.pointerId);
    const box = canvas.getBoundingClientRect();
    const row = moved < 4 && event.button === 0 ? pick(event.clientX - box.left, event.clientY - box.top) : -1;
    if (row >= 0) changed(page.motion.time[row]);
  });
  canvas.addEventListener("pointermove", (event) => {
    const before = held.get(event.pointerId);
    if (!before) return;
    const spread = held.size === 2 ? apart() : 0, dx = event.clientX - before.x, dy = event.clientY - before.y;
    held.set(event.pointerId, { x: event.clientX, y: event.clientY });
    moved += Math.abs(dx) + Math.abs(dy);
    if (held.size === 2) camera.far *= spread / Math.max(apart(), 1);
    else if (event.buttons & 2 || event.shiftKey) {
      const { side, above } = frame(), scale = 0.62 * camera.far / Math.max(canvas.clientHeight, 1);
      camera.at = camera.at.map((v, k) => v + scale * (dy * above[k] - dx * side[k]));
      camera.follow = "";
    } else {
      camera.turn -= 0.008 * dx;
      camera.rise = Math.min(1.57, Math.max(-0.4, camera.rise + 0.008 * dy));
    }
    changed();
  });
  canvas.addEventListener("wheel", (event) => {
    event.preventDefault();
    camera.far = Math.min(8, Math.max(0.05, camera.far * Math.exp(0.001 * event.deltaY)));
    changed();
  }, { passive: false });
  canvas.addEventListener("contextmenu", (event) => event.preventDefault());

  return {
    shown, camera, look: (name) => { look(name); changed(); }, paint,
    move(joints, tip, row) { poses = bodyPoses(page.bodies, joints); tool = tip; trace.row = row; aim(); },
    color(values, scale) {
      tint = scale;
      gl.bindBuffer(gl.ARRAY_BUFFER, map.values);
      gl.bufferSubData(gl.ARRAY_BUFFER, 0, values);
    },
    colorTrace(values, scale) {
      trace.scale = scale;
      gl.bindBuffer(gl.ARRAY_BUFFER, trace.tinted);
      if (values) gl.bufferSubData(gl.ARRAY_BUFFER, 0, values);
    },
  };
}
