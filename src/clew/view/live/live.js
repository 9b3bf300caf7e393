// Takes in what the server sends, and lets the user pause, follow, pan and zoom.
import { MapLayers, View, colours, drawRun } from "./draw.js";

const byId = (id) => document.getElementById(id);
const canvas = byId("map"), view = new View(), layers = new MapLayers();

// What has come so far; what comes during a pause waits in `waiting`.
const run = {
  poses: new Float32Array(3 * 256), keyframes: 0, clouds: [], ready: 0, firstMoved: Infinity, closures: new Int32Array(0),
  scan: new Int16Array(0), robot: [0, 0, 0], sensor: [0, 0, 0], scans: 0,
};
const waiting = [];
let mode = "fit", paused = false, dirty = true, colour = colours(), last = false;

function bytes(text) { return Uint8Array.from(atob(text), (letter) => letter.charCodeAt(0)).buffer; }

function take(message) {
  const poses = new Float32Array(bytes(message.poses)), needed = 3 * message.keyframes;
  if (run.poses.length < needed) {
    const grown = new Float32Array(2 * needed);
    grown.set(run.poses);
    run.poses = grown;
  }
  run.poses.set(poses, 3 * message.first);
  run.keyframes = message.keyframes;
  run.firstMoved = Math.min(run.firstMoved, message.first);
  const points = new Int16Array(bytes(message.points));
  let begin = 0;
  for (const count of message.clouds) {
    run.clouds.push(points.subarray(2 * begin, 2 * (begin + count)));
    begin += count;
  }
  run.ready = Math.min(run.clouds.length, run.keyframes);
  run.closures = new Int32Array(bytes(message.closures));
  run.scan = new Int16Array(bytes(message.scan));
  Object.assign(run, { robot: message.robot, sensor: message.sensor, scans: message.scans });
  tell(message);
  dirty = true;
}

function tell(message) {
  byId("stage").textContent = message.stage;
  byId("stage").className = "";
  byId("empty").hidden = message.scans > 0;
  const known = message.total > 0;
  byId("progress").hidden = !known;
  if (known) byId("progress").value = message.scans / message.total;
  const number = (value) => value.toLocaleString("en");
  byId("numbers").textContent = `${number(message.scans)}${known ? " of " + number(message.total) : ""} scans, `
    + `${number(message.keyframes)} keyframes, ${number(run.closures.length / 2)} loop closures `
    + `(${number(message.rejected)} candidates turned down), ${number(Math.round(message.seconds))} s of the log`;
  Object.assign(document.body.dataset, {
    stage: message.stage, keyframes: message.keyframes, ready: run.ready, closures: run.closures.length / 2,
  });
}

function connect() {
  const source = new EventSource("events");
  const receive = (event) => {
    const message = JSON.parse(event.data);
    if (paused) waiting.push(message); else take(message);
  };
  source.onopen = () => { run.clouds = []; run.ready = 0; run.keyframes = 0; run.firstMoved = 0; waiting.length = 0; };
  source.onmessage = receive;
  source.addEventListener("last", (event) => {
    source.close();
    last = true;
    receive(event);
  });
  source.onerror = () => {
    if (last) return;
    const closed = source.readyState === EventSource.CLOSED;
    byId("stage").textContent = closed ? "the run is over, or its server has gone" : "connection lost, trying again";
    byId("stage").className = "lost";
  };
}

function press(id, on) { byId(id).setAttribute("aria-pressed", String(on)); }

function setMode(next) {
  mode = next;
  press("follow", mode === "follow");
  press("fit", mode === "fit");
  dirty = true;
}

function setPaused(on) {
  paused = on;
  press("pause", on);
  byId("pause").textContent = on ? "Resume" : "Pause";
  if (!on) for (const message of waiting.splice(0)) take(message);
}

function fit(width, height) {
  if (!run.keyframes) return;
  let [x0, x1, y0, y1] = [Infinity, -Infinity, Infinity, -Infinity];
  const stride = Math.max(1, Math.floor(run.ready / 300));
  for (let k = 0; k < run.ready; k += stride) {
    const c = Math.cos(run.poses[3 * k + 2]), s = Math.sin(run.poses[3 * k + 2]), cloud = run.clouds[k];
    for (let i = 0; i + 1 < cloud.length; i += 24) {
      const px = cloud[i] / 100, py = cloud[i + 1] / 100;
      if (Math.hypot(px, py) > 15) continue;
      const x = run.poses[3 * k] + c * px - s * py, y = run.poses[3 * k + 1] + s * px + c * py;
      x0 = Math.min(x0, x); x1 = Math.max(x1, x); y0 = Math.min(y0, y); y1 = Math.max(y1, y);
    }
  }
  for (let k = 0; k < run.keyframes; k++) {
    const x = run.poses[3 * k], y = run.poses[3 * k + 1];
    x0 = Math.min(x0, x); x1 = Math.max(x1, x); y0 = Math.min(y0, y); y1 = Math.max(y1, y);
  }
  const wanted = Math.min(width / (x1 - x0 + 2), height / (y1 - y0 + 2));
  const outside = view.px(x0, width) < 0 || view.px(x1, width) > width || view.py(y1, height) < 0
    || view.py(y0, height) > height;
  // A view that still fits stays: one that moved with each scan would be redrawn from scratch each time.
  if (outside || wanted > 1.6 * view.scale || wanted < view.scale || last) {
    Object.assign(view, { x: (x0 + x1) / 2, y: (y0 + y1) / 2, scale: last ? wanted : 0.85 * wanted });
  }
}

function follow(width, height) {
  const u = view.px(run.robot[0], width), v = view.py(run.robot[1], height);
  // Jump when the robot comes near the edge, for the same reason.
  if (Math.abs(u - width / 2) > 0.3 * width || Math.abs(v - height / 2) > 0.3 * height) [view.x, view.y] = run.robot;
}

function scaleBar(pixels) {
  const longest = 120 * pixels / view.scale, power = 10 ** Math.floor(Math.log10(longest));
  const metres = Math.max(...[1, 2, 5].map((n) => n * power).filter((n) => n <= longest * (1 + 1e-9)));
  byId("bar").style.width = `${metres * view.scale / pixels}px`;
  byId("length").textContent = metres >= 1 ? `${metres} m` : `${Math.round(100 * metres)} cm`;
}

function draw() {
  requestAnimationFrame(draw);
  const pixels = window.devicePixelRatio || 1;
  const width = Math.round(canvas.clientWidth * pixels), height = Math.round(canvas.clientHeight * pixels);
  if (canvas.width !== width || canvas.height !== height) {
    Object.assign(canvas, { width, height });
    dirty = true;
  }
  if (!dirty || !width || !height) return;
  dirty = false;
  if (mode === "fit") fit(width, height);
  if (mode === "follow") follow(width, height);
  drawRun(canvas, run, view, layers, colour, pixels);
  scaleBar(pixels);
  document.body.dataset.drawn = layers.done;
}

function move(du, dv) {
  view.x -= du / view.scale;
  view.y += dv / view.scale;
  setMode("free");
}

function zoom(factor, u = canvas.width / 2, v = canvas.height / 2) {
  const scale = Math.min(2000, Math.max(0.5, view.scale * factor));
  view.x += (u - canvas.width / 2) * (1 / view.scale - 1 / scale);
  view.y -= (v - canvas.height / 2) * (1 / view.scale - 1 / scale);
  view.scale = scale;
  setMode(mode === "follow" ? "follow" : "free");
}

function controls() {
  const pixels = () => window.devicePixelRatio || 1, pointers = new Map();
  byId("pause").onclick = () => setPaused(!paused);
  byId("follow").onclick = () => setMode(mode === "follow" ? "free" : "follow");
  byId("fit").onclick = () => setMode("fit");
  canvas.addEventListener("pointerdown", (event) => {
    canvas.setPointerCapture(event.pointerId);
    pointers.set(event.pointerId, event);
  });
  canvas.addEventListener("pointermove", (event) => {
    const before = pointers.get(event.pointerId);
    if (!before) return;
    const other = [...pointers.values()].find((pointer) => pointer.pointerId !== event.pointerId);
    if (other) {
      const gap = (pointer) => Math.hypot(pointer.clientX - other.clientX, pointer.clientY - other.clientY);
      zoom(gap(event) / Math.max(gap(before), 1));
    } else {
      move((event.clientX - before.clientX) * pixels(), (event.clientY - before.clientY) * pixels());
    }
    pointers.set(event.pointerId, event);
  });
  for (const name of ["pointerup", "pointercancel"]) {
    canvas.addEventListener(name, (event) => pointers.delete(event.pointerId));
  }
  canvas.addEventListener("wheel", (event) => {
    event.preventDefault();
    zoom(Math.exp(-0.0015 * event.deltaY), event.offsetX * pixels(), event.offsetY * pixels());
  }, { passive: false });
  const keys = {
    " ": () => setPaused(!paused), f: () => byId("follow").click(), 0: () => setMode("fit"), "+": () => zoom(1.25),
    "=": () => zoom(1.25), "-": () => zoom(0.8), ArrowLeft: () => move(60, 0), ArrowRight: () => move(-60, 0),
    ArrowUp: () => move(0, 60), ArrowDown: () => move(0, -60),
  };
  document.addEventListener("keydown", (event) => {
    if (event.ctrlKey || event.metaKey || event.altKey || !keys[event.key]) return;
    if (event.key === " " && event.target.tagName === "BUTTON") return; // it presses that button
    event.preventDefault();
    keys[event.key]();
  });
  matchMedia("(prefers-color-scheme: dark)").addEventListener("change", () => { colour = colours(); dirty = true; });
}

controls();
connect();
draw();
