"""The text of the page that ``gait_page`` fills in: layout, shaders and the small program that draws a motion."""

PAGE = """<!doctype html>
<html lang="en"><meta charset="utf-8"><title>@TITLE@</title>
<meta name="viewport" content="width=device-width, initial-scale=1">
<style>
html,body{margin:0;height:100%;overflow:hidden;background:#fff;font:14px system-ui,sans-serif;color:#1f2933}
canvas{position:absolute;inset:0;width:100%;height:100%;cursor:grab;touch-action:none}
header{position:absolute;left:20px;top:14px;pointer-events:none}
h1{font-size:20px;margin:0 0 4px}p{margin:0;color:@COLOUR@}
footer{position:absolute;left:20px;right:20px;bottom:16px;display:flex;gap:14px;align-items:center}
button{width:76px;padding:6px;border:1px solid #c3cad2;border-radius:6px;background:#fff;font:inherit;cursor:pointer}
input{flex:1}output{width:62px;text-align:right;font-variant-numeric:tabular-nums}
span.foot{padding-left:2px;white-space:nowrap}span.foot i{display:inline-block;width:10px;height:10px;border-radius:5px;margin-right:4px}
</style>
<canvas id="view"></canvas>
<header><h1>@TITLE@</h1><p>@VERDICT@</p></header>
<footer><button id="play">Pause</button><input id="time" type="range" min="0" value="0" step="1" aria-label="time">
<output id="clock"></output><span id="feet"></span></footer>
<script id="data" type="application/json">@DATA@</script>
<script>
"use strict";
const D = JSON.parse(document.getElementById("data").textContent);
const floats = text => new Float32Array(Uint8Array.from(atob(text), c => c.charCodeAt(0)).buffer);
for (const key of ["nodes","normals","tints","lines","sides","times","torso","turn","legs","forces"]) D[key] = floats(D[key]);
const count = D.times.length, feet = D.names.length, canvas = document.getElementById("view");
const gl = canvas.getContext("webgl", {antialias: true, preserveDrawingBuffer: true});
if (!gl) document.querySelector("p").textContent = "This browser shows no WebGL.";

// ---- vectors and matrices (columns first)
const add = (a, b, s = 1) => [a[0] + s*b[0], a[1] + s*b[1], a[2] + s*b[2]];
const dot = (a, b) => a[0]*b[0] + a[1]*b[1] + a[2]*b[2];
const cross = (a, b) => [a[1]*b[2]-a[2]*b[1], a[2]*b[0]-a[0]*b[2], a[0]*b[1]-a[1]*b[0]];
const norm = a => Math.hypot(...a), unit = a => { const n = norm(a) || 1; return a.map(v => v/n); };
const times = (a, b) => { const m = new Float32Array(16);
  for (let c = 0; c < 4; c++) for (let r = 0; r < 4; r++) for (let k = 0; k < 4; k++) m[4*c+r] += a[4*k+r]*b[4*c+k];
  return m; };
const columns = (x, y, z, p) => new Float32Array([...x, 0, ...y, 0, ...z, 0, ...p, 1]);
const scaled = (a, s) => a.map(v => v*s);
function along(from, to, thick) {  // the unit cylinder on z, from one point to another
  const z = add(to, from, -1), w = unit(z), x = unit(cross(w, Math.abs(w[2]) < .9 ? [0,0,1] : [1,0,0]));
  return columns(scaled(x, thick), scaled(cross(w, x), thick), z, from);
}

// ---- shapes: corner, normal, colour
function grid(rows, cols, at) { const v = [];
  for (let i = 0; i + 1 < rows; i++) for (let j = 0; j + 1 < cols; j++)
    for (const [a, b] of [[i,j],[i+1,j],[i+1,j+1],[i,j],[i+1,j+1],[i,j+1]]) v.push(...at(a, b));
  return v; }
const turn = k => [Math.cos(k*Math.PI/8), Math.sin(k*Math.PI/8)];
const cylinder = grid(2, 17, (i, j) => { const [c, s] = turn(j); return [c, s, i, c, s, 0, 1, 1, 1]; });
const spike = grid(2, 17, (i, j) => { const [c, s] = turn(j); return [c*(1-i), s*(1-i), i, c, s, .4, 1, 1, 1]; });
const ball = grid(9, 17, (i, j) => { const [c, s] = turn(j), h = Math.PI*(i/8 - .5), k = Math.cos(h);
  return [c*k, s*k, Math.sin(h), c*k, s*k, Math.sin(h), 1, 1, 1]; });
const disc = grid(2, 17, (i, j) => { const [c, s] = turn(j); return [c*i, s*i, 0, 0, 0, 1, 1, 1, 1]; });
const cube = []; for (let a = 0; a < 3; a++) for (const s of [-1, 1]) {
  const n = [0,0,0]; n[a] = s;
  for (const [u, v] of [[-1,-1],[1,-1],[1,1],[-1,-1],[1,1],[-1,1]]) {
    const p = [0,0,0]; p[a] = s; p[(a+1)%3] = u; p[(a+2)%3] = v; cube.push(...p, ...n, 1, 1, 1); } }
const cols = D.columns, at3 = (array, k) => [array[3*k], array[3*k+1], array[3*k+2]];
const ground = grid(D.nodes.length/3/cols, cols, (i, j) => { const k = i*cols + j;
  return [...at3(D.nodes, k), ...at3(D.normals, k), ...at3(D.tints, k)]; });
for (let k = 0; k < D.sides.length; k += 6) ground.push(...D.sides.subarray(k, k + 6), .81, .78, .73);
const ruled = []; for (let k = 0; k < D.lines.length; k += 3)
  ruled.push(D.lines[k], D.lines[k+1], D.lines[k+2] + .004, 0, 0, 1, .56, .6, .62);
const way = []; for (let k = 0; k < count; k++) way.push(...at3(D.torso, k), 0, 0, 1, .12, .16, .2);

// ---- drawing
const vertex = `attribute vec3 at, normal, tint; uniform mat4 world, seen; uniform vec3 colour, light; uniform float flat_;
varying vec3 shown; void main() { vec3 n = normalize((world * vec4(normal, 0.)).xyz);
float s = mix(.78 + .3 * clamp(dot(n, light), -.6, 1.), 1., flat_); shown = min(tint * colour * s, 1.);
gl_Position = seen * world * vec4(at, 1.); }`;
const fragment = `precision mediump float; varying vec3 shown; void main() { gl_FragColor = vec4(shown, 1.); }`;
let program, place = {}, shapes = {};
function prepare() {
  program = gl.createProgram();
  for (const [kind, text] of [[gl.VERTEX_SHADER, vertex], [gl.FRAGMENT_SHADER, fragment]]) {
    const shader = gl.createShader(kind); gl.shaderSource(shader, text); gl.compileShader(shader);
    if (!gl.getShaderParameter(shader, gl.COMPILE_STATUS)) throw gl.getShaderInfoLog(shader);
    gl.attachShader(program, shader); }
  gl.linkProgram(program); gl.useProgram(program); gl.enable(gl.DEPTH_TEST); gl.clearColor(1, 1, 1, 1);
  for (const name of ["world", "seen", "colour", "light", "flat_"]) place[name] = gl.getUniformLocation(program, name);
  for (const [name, v] of Object.entries({ground, ruled, way, cylinder, spike, ball, disc, cube})) {
    const buffer = gl.createBuffer(); gl.bindBuffer(gl.ARRAY_BUFFER, buffer);
    gl.bufferData(gl.ARRAY_BUFFER, new Float32Array(v), gl.STATIC_DRAW); shapes[name] = [buffer, v.length/9]; }
}
function put(name, world, colour, mode = gl.TRIANGLES, flat = 0, many = null) {
  const [buffer, vertices] = shapes[name]; gl.bindBuffer(gl.ARRAY_BUFFER, buffer);
  ["at", "normal", "tint"].forEach((attribute, k) => { const where = gl.getAttribLocation(program, attribute);
    if (where < 0) return; gl.enableVertexAttribArray(where); gl.vertexAttribPointer(where, 3, gl.FLOAT, false, 36, 12*k); });
  gl.uniformMatrix4fv(place.world, false, world); gl.uniform3fv(place.colour, colour); gl.uniform1f(place.flat_, flat);
  gl.drawArrays(mode, 0, many === null ? vertices : many);
}
const rgb = text => [1, 3, 5].map(k => parseInt(text.slice(k, k + 2), 16)/255);
const steel = rgb("#5b6b7b"), rim = rgb("#2b3642"), shell = rgb("#dbe2ea"), red = rgb("#d1233b");
const eye4 = columns([1,0,0], [0,1,0], [0,0,1], [0,0,0]);
let azimuth = D.azimuth, elevation = D.elevation, distance = D.distance, target = D.target.slice(), frame = 0;
function draw() {
  const width = canvas.width = canvas.clientWidth * devicePixelRatio, height = canvas.height = canvas.clientHeight * devicePixelRatio;
  gl.viewport(0, 0, width, height); gl.clear(gl.COLOR_BUFFER_BIT | gl.DEPTH_BUFFER_BIT);
  const c = Math.cos(elevation), back = [c*Math.cos(azimuth), c*Math.sin(azimuth), Math.sin(elevation)];
  const right = unit(cross([0,0,1], back)), up = cross(back, right), eye = add(target, back, distance);
  const look = columns([right[0],up[0],back[0]], [right[1],up[1],back[1]], [right[2],up[2],back[2]], [-dot(right,eye), -dot(up,eye), -dot(back,eye)]);
  const f = 1.9, near = .02*distance, far = 6*distance, lens = new Float32Array(16);
  lens[0] = f*Math.min(1, height/width); lens[5] = lens[0]*width/height; lens[10] = (far+near)/(near-far); lens[11] = -1; lens[14] = 2*far*near/(near-far);
  gl.uniformMatrix4fv(place.seen, false, times(lens, look));
  gl.uniform3fv(place.light, unit(add(add(scaled(right, -.45), up, .75), back, .55)));
  put("ground", eye4, [1,1,1]); put("ruled", eye4, [1,1,1], gl.LINES, 1); put("way", eye4, [1,1,1], gl.LINE_STRIP, 1, frame + 1);
  for (const [sample, foot, x, y, z] of D.footholds) if (sample <= frame*D.stride) {
    const r = .055*D.size; put("ball", columns([r,0,0], [0,r,0], [0,0,.25*r], [x,y,z]), rgb(D.colours[foot % D.colours.length])); }
  const p = at3(D.torso, frame), R = D.turn.subarray(9*frame, 9*frame + 9), axis = k => [R[k], R[3+k], R[6+k]], h = D.half;
  put("cube", columns(scaled(axis(0), h[0]), scaled(axis(1), h[1]), scaled(axis(2), h[2]), p), shell);
  const nose = add(add(p, axis(0), .72*h[0]), axis(2), h[2]);
  put("cube", columns(scaled(axis(0), .12*h[0]), scaled(axis(1), .3*h[1]), scaled(axis(2), .06*h[2]), nose), steel);
  const bone = .045*D.size, round = (q, r, colour) => put("ball", columns([r,0,0], [0,r,0], [0,0,r], q), colour);
  for (let k = 0; k < feet; k++) {
    const [hip, knee, toe] = [0, 1, 2].map(j => at3(D.legs, 3*(feet*frame + k) + j));
    put("cylinder", along(hip, knee, bone), steel); put("cylinder", along(knee, toe, .7*bone), steel);
    round(hip, 1.3*bone, rim); round(knee, 1.1*bone, rim); round(toe, .95*bone, rgb(D.colours[k]));
    const force = scaled(at3(D.forces, feet*frame + k), D.newton), length = norm(force), thick = .022*D.size;
    if (length > 2*thick) { const neck = add(toe, force, 1 - Math.min(5.5*thick, .6*length)/length);
      put("cylinder", along(toe, neck, thick), red); put("spike", along(neck, add(toe, force), 2.4*thick), red); }
  }
  document.getElementById("clock").value = D.times[frame].toFixed(2) + " s";
}

// ---- what the hand does
const slider = document.getElementById("time"), button = document.getElementById("play");
slider.max = count - 1;
document.getElementById("feet").innerHTML = D.names.map((name, k) =>
  `<span class="foot"><i style="background:${D.colours[k]}"></i>${name.replace(/[<>&"']/g, letter => `&#${letter.charCodeAt(0)};`)}</span> `).join("");
let playing = !location.hash, clock = null, passed = 0;
function go(value) { frame = Math.max(0, Math.min(count - 1, value)); slider.value = frame; passed = D.times[frame]; draw(); }
slider.oninput = () => { stop(); go(+slider.value); };
function stop() { playing = false; button.textContent = "Play"; }
button.onclick = () => { playing = !playing; clock = null; button.textContent = playing ? "Pause" : "Play"; if (playing) requestAnimationFrame(tick); };
function tick(now) { if (!playing) return;
  if (clock !== null) { passed += (now - clock)/1000; if (passed > D.times[count-1] + .8) passed = 0; }
  clock = now; let k = frame; if (D.times[k] > passed) k = 0;
  while (k + 1 < count && D.times[k+1] <= passed) k++;
  frame = k; slider.value = k; draw(); requestAnimationFrame(tick); }
let held = null;
canvas.onpointerdown = e => { held = [e.clientX, e.clientY, e.shiftKey || e.button === 2]; canvas.setPointerCapture(e.pointerId); };
canvas.onpointerup = () => { held = null; };
canvas.oncontextmenu = e => e.preventDefault();
canvas.onpointermove = e => { if (!held) return; const dx = e.clientX - held[0], dy = e.clientY - held[1];
  if (held[2]) { const s = distance/canvas.clientHeight; target = add(target, [-Math.sin(azimuth), Math.cos(azimuth), 0], -dx*s); target[2] += dy*s; }
  else { azimuth -= .006*dx; elevation = Math.max(-.2, Math.min(1.55, elevation + .006*dy)); }
  held[0] = e.clientX; held[1] = e.clientY; draw(); };
canvas.addEventListener("wheel", e => { e.preventDefault(); distance *= Math.exp(.001*e.deltaY); draw(); }, {passive: false});
addEventListener("resize", draw);
addEventListener("keydown", e => { if (e.key === " ") { e.preventDefault(); button.click(); } });
if (gl) { prepare(); go(location.hash ? Math.round(parseFloat(location.hash.slice(1))*(count - 1)) : 0); if (playing) requestAnimationFrame(tick); else stop(); }
</script></html>
"""  # noqa: E501 — lines of another language
