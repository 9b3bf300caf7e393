// Many lines in few strokes. A long path of thousands of lines is slow to fill, so strokes are made in portions.

const PORTION = 400; // lines a stroke

/** A polyline with as many points as can be told apart at a scale; the choices are kept, one for each doubling. */
class Polyline {
  constructor(x, y, time) {
    this.x = x;
    this.y = y;
    this.time = time;
    this.kept = new Map();
  }

  rows(scale) {
    const octave = Math.ceil(Math.log2(scale));
    let rows = this.kept.get(octave);
    if (!rows) {
      const least = 0.7 / 2 ** octave, chosen = [];
      let lastX = Infinity, lastY = Infinity;
      for (let i = 0; i < this.x.length; i++) {
        if (Math.abs(this.x[i] - lastX) + Math.abs(this.y[i] - lastY) > least || i === this.x.length - 1) {
          chosen.push(i);
          lastX = this.x[i];
          lastY = this.y[i];
        }
      }
      rows = Int32Array.from(chosen);
      this.kept.set(octave, rows);
    }
    return rows;
  }

  /** Stroke it until a moment; what is far outside of the picture is left out. */
  stroke(context, camera, until, from = -Infinity) {
    const rows = this.rows(camera.scale), { x, y, time } = this;
    let open = false, drawn = 0, beforeX = 0, beforeY = 0, beforeIn = false;
    context.beginPath();
    for (let k = 0; k < rows.length; k++) {
      const i = rows[k];
      if (time[i] > until) break;
      const sx = camera.toScreenX(x[i]), sy = camera.toScreenY(y[i]);
      const inside = sx > -200 && sx < camera.width + 200 && sy > -200 && sy < camera.height + 200;
      if (k > 0 && time[i] >= from && (inside || beforeIn)) {
        if (!open) context.moveTo(beforeX, beforeY);
        context.lineTo(sx, sy);
        open = true;
        if (++drawn % PORTION === 0) {
          context.stroke();
          context.beginPath();
          open = false;
        }
      } else open = false;
      [beforeX, beforeY, beforeIn] = [sx, sy, inside];
    }
    context.stroke();
  }
}

/** Lines between vertices, in the order of the moments at which they come. */
class Segments {
  /** @param {Int32Array} ends pairs of vertices @param {ArrayLike<number>} rows which pairs @param {Float32Array} born */
  constructor(ends, rows, born) {
    this.rows = Int32Array.from(rows).sort((a, b) => born[a] - born[b] || a - b);
    this.born = Float32Array.from(this.rows, (row) => born[row]);
    this.ends = ends;
  }

  get length() { return this.rows.length; }

  /** Stroke those until a moment; in space those far away are fainter. */
  stroke(context, camera, projection, until) {
    const { away } = projection;
    if (!away) {
      this.pass(context, camera, projection, until, null, 0, 0);
      return;
    }
    let near = Infinity, far = -Infinity;
    for (let i = 0; i < away.length; i++) {
      near = Math.min(near, away[i]);
      far = Math.max(far, away[i]);
    }
    const alpha = context.globalAlpha, slices = 4, slice = (far - near) / slices || 1;
    for (let s = slices - 1; s >= 0; s--) {
      context.globalAlpha = alpha * [1, 0.72, 0.45, 0.25][s];
      this.pass(context, camera, projection, until, away, near + s * slice, s === slices - 1 ? Infinity : near + (s + 1) * slice);
    }
    context.globalAlpha = alpha;
  }

  pass(context, camera, projection, until, away, near, far) {
    const { u, v } = projection, { ends, rows } = this;
    const last = after(this.born, until), w = camera.width + 20, h = camera.height + 20;
    let drawn = 0, tip = -1, penX = 0, penY = 0; // a chain goes on at its tip; the pen may lag behind by less than a pixel
    context.beginPath();
    for (let k = 0; k < last; k++) {
      const a = ends[2 * rows[k]], b = ends[2 * rows[k] + 1];
      if (away && (away[b] < near || away[b] >= far)) continue;
      const ax = camera.toScreenX(u[a]), ay = camera.toScreenY(v[a]);
      const bx = camera.toScreenX(u[b]), by = camera.toScreenY(v[b]);
      if ((ax < -20 && bx < -20) || (ay < -20 && by < -20) || (ax > w && bx > w) || (ay > h && by > h)) continue;
      if (a !== tip || drawn === PORTION) {
        if (drawn === PORTION) {
          context.stroke();
          context.beginPath();
          drawn = 0;
        }
        if (a !== tip) [penX, penY] = [ax, ay];
        context.moveTo(penX, penY);
      }
      tip = b;
      if (Math.abs(penX - bx) + Math.abs(penY - by) < 0.7) continue;
      context.lineTo(bx, by);
      [penX, penY] = [bx, by];
      drawn++;
    }
    context.stroke();
  }
}

/** Points of one shape in few fills. */
function fillPoints(context, camera, xs, ys, rows, size, shape) {
  let drawn = 0;
  context.beginPath();
  for (const i of rows) {
    const sx = camera.toScreenX(xs[i]), sy = camera.toScreenY(ys[i]);
    if (sx < -9 || sy < -9 || sx > camera.width + 9 || sy > camera.height + 9) continue;
    shape(context, sx, sy, size);
    if (++drawn % PORTION === 0) {
      context.fill();
      context.beginPath();
    }
  }
  context.fill();
}

const square = (context, x, y, size) => context.rect(x - size, y - size, 2 * size, 2 * size);
const diamond = (context, x, y, size) => {
  context.moveTo(x, y - size);
  context.lineTo(x + size, y);
  context.lineTo(x, y + size);
  context.lineTo(x - size, y);
  context.closePath();
};
const triangle = (context, x, y, size) => {
  context.moveTo(x, y - size * 1.15);
  context.lineTo(x + size, y + size * 0.75);
  context.lineTo(x - size, y + size * 0.75);
  context.closePath();
};
