// Draws a run: free space and walls from the returns of the keyframes at their present poses, path, closures, scan.

const GAP = 0.09; // radians between two returns from which nothing is known of what lies between

// The part of the world that a canvas shows: world (x, y) at its middle, pixels a metre.
export class View {
  constructor() { this.x = 0; this.y = 0; this.scale = 40; }
  px(x, width) { return (x - this.x) * this.scale + width / 2; }
  py(y, height) { return height / 2 - (y - this.y) * this.scale; }
  same(other) { return other && this.x === other.x && this.y === other.y && this.scale === other.scale; }
  copy() { return Object.assign(new View(), this); }
}

export function colours() {
  const style = getComputedStyle(document.documentElement);
  const names = ["paper", "ink", "unknown", "free", "occupied", "path", "closure", "scan"];
  return Object.fromEntries(names.map((name) => [name, style.getPropertyValue("--" + name).trim()]));
}

// Free space and walls on canvases of their own, so that a frame that only adds a keyframe costs only that.
export class MapLayers {
  constructor() {
    this.free = document.createElement("canvas");
    this.walls = document.createElement("canvas");
    this.done = 0; // keyframes drawn so far
    this.view = null;
  }

  update(run, view, width, height, colour) {
    const fresh = !view.same(this.view) || this.free.width !== width || this.free.height !== height
      || run.firstMoved < this.done || this.colour !== colour.free;
    if (fresh) {
      for (const canvas of [this.free, this.walls]) { canvas.width = width; canvas.height = height; }
      this.done = 0;
      this.view = view.copy();
      this.colour = colour.free;
    }
    run.firstMoved = Infinity;
    const free = this.free.getContext("2d"), walls = this.walls.getContext("2d");
    free.fillStyle = colour.free;
    walls.fillStyle = colour.occupied;
    const size = Math.max(1, Math.min(3, Math.round(view.scale * 0.05)));
    for (; this.done < run.ready; this.done++) this.keyframe(run, this.done, view, width, height, free, walls, size);
  }

  keyframe(run, k, view, width, height, free, walls, size) {
    const cloud = run.clouds[k], n = cloud.length / 2;
    if (!n) return;
    const x = run.poses[3 * k], y = run.poses[3 * k + 1], turn = run.poses[3 * k + 2];
    const c = Math.cos(turn), s = Math.sin(turn);
    const [sx, sy] = run.sensor;
    const eye = [view.px(x + c * sx - s * sy, width), view.py(y + s * sx + c * sy, height)];
    free.beginPath();
    free.moveTo(...eye);
    let before = NaN;
    for (let i = 0; i < n; i++) {
      const px = cloud[2 * i] / 100, py = cloud[2 * i + 1] / 100;
      const u = view.px(x + c * px - s * py, width), v = view.py(y + s * px + c * py, height);
      const angle = Math.atan2(py - sy, px - sx);
      if (Math.abs(angle - before) > GAP) free.lineTo(...eye);
      free.lineTo(u, v);
      walls.fillRect(Math.round(u - size / 2), Math.round(v - size / 2), size, size);
      before = angle;
    }
    free.closePath();
    free.fill();
  }
}

export function drawRun(canvas, run, view, layers, colour, pixels) {
  const width = canvas.width, height = canvas.height, context = canvas.getContext("2d");
  layers.update(run, view, width, height, colour);
  context.fillStyle = colour.unknown;
  context.fillRect(0, 0, width, height);
  context.drawImage(layers.free, 0, 0);
  context.drawImage(layers.walls, 0, 0);
  drawPath(context, run, view, width, height, colour, pixels);
  drawClosures(context, run, view, width, height, colour, pixels);
  drawRobot(context, run, view, width, height, colour, pixels);
}

function drawPath(context, run, view, width, height, colour, pixels) {
  context.strokeStyle = colour.path;
  context.lineWidth = 1.6 * pixels;
  context.lineJoin = "round";
  context.beginPath();
  for (let k = 0; k < run.keyframes; k++) {
    context.lineTo(view.px(run.poses[3 * k], width), view.py(run.poses[3 * k + 1], height));
  }
  context.stroke();
}

function drawClosures(context, run, view, width, height, colour, pixels) {
  context.strokeStyle = context.fillStyle = colour.closure;
  context.lineWidth = 1.2 * pixels;
  context.beginPath();
  for (let i = 0; i + 1 < run.closures.length; i += 2) {
    const a = 3 * run.closures[i], b = 3 * run.closures[i + 1];
    const u = view.px(run.poses[a], width), v = view.py(run.poses[a + 1], height);
    context.moveTo(u, v);
    context.lineTo(view.px(run.poses[b], width), view.py(run.poses[b + 1], height));
    context.rect(u - pixels, v - pixels, 2 * pixels, 2 * pixels);
  }
  context.stroke();
}

function drawRobot(context, run, view, width, height, colour, pixels) {
  if (!run.scans) return;
  const [x, y, turn] = run.robot, c = Math.cos(turn), s = Math.sin(turn);
  context.fillStyle = colour.scan;
  const size = Math.max(2, 2 * pixels);
  for (let i = 0; i + 1 < run.scan.length; i += 2) {
    const px = run.scan[i] / 100, py = run.scan[i + 1] / 100;
    context.fillRect(view.px(x + c * px - s * py, width) - size / 2,
      view.py(y + s * px + c * py, height) - size / 2, size, size);
  }
  const u = view.px(x, width), v = view.py(y, height), r = 9 * pixels;
  context.fillStyle = colour.path;
  context.strokeStyle = colour.paper;
  context.lineWidth = 1.5 * pixels;
  context.beginPath();
  for (const [way, length] of [[0, r], [2.5, 0.8 * r], [Math.PI, 0.3 * r], [-2.5, 0.8 * r]]) {
    context.lineTo(u + length * Math.cos(turn + way), v - length * Math.sin(turn + way));
  }
  context.closePath();
  context.fill();
  context.stroke();
}
