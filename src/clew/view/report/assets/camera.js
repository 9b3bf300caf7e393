// Where the map is looked at from. In the plane a camera shifts and scales; in space it also turns (orthographic).

class Camera {
  /** @param {number} dim 2 or 3 */
  constructor(dim) {
    this.dim = dim;
    this.x = 0;
    this.y = 0;
    this.scale = 20; // pixels a metre
    this.width = 1;
    this.height = 1;
    this.yaw = -0.6;
    this.pitch = 0.6;
    this.turned = 0; // counts turns, so that others see that projections are stale
  }

  toScreenX(x) { return (x - this.x) * this.scale + this.width / 2; }
  toScreenY(y) { return this.height / 2 - (y - this.y) * this.scale; }
  toWorld(sx, sy) {
    return [(sx - this.width / 2) / this.scale + this.x, (this.height / 2 - sy) / this.scale + this.y];
  }

  pan(dx, dy) {
    this.x -= dx / this.scale;
    this.y += dy / this.scale;
  }

  /** Zoom about a point of the screen. */
  zoom(factor, sx = this.width / 2, sy = this.height / 2) {
    const [x, y] = this.toWorld(sx, sy);
    this.scale = Math.min(Math.max(this.scale * factor, this.least / 8), 4000);
    const [newX, newY] = this.toWorld(sx, sy);
    this.x += x - newX;
    this.y += y - newY;
  }

  turn(dYaw, dPitch) {
    this.yaw += dYaw;
    this.pitch = Math.min(Math.max(this.pitch + dPitch, -Math.PI / 2), Math.PI / 2);
    this.turned++;
  }

  /** Axes of the screen in the world: right, up, away. */
  axes() {
    if (this.dim === 2) return [[1, 0, 0], [0, 1, 0], [0, 0, -1]];
    const [c, s, cp, sp] = [Math.cos(this.yaw), Math.sin(this.yaw), Math.cos(this.pitch), Math.sin(this.pitch)];
    return [[c, s, 0], [-s * sp, c * sp, cp], [-s * cp, c * cp, -sp]];
  }

  /** See a box; `box` is [x0, x1, y0, y1] on the screen's plane. */
  fit(box, margin = 0.06) {
    const w = Math.max(box[1] - box[0], 0.5), h = Math.max(box[3] - box[2], 0.5);
    this.x = (box[0] + box[1]) / 2;
    this.y = (box[2] + box[3]) / 2;
    this.scale = Math.min(this.width / w, this.height / h) * (1 - 2 * margin);
  }

  /** Remember the scale that shows all. */
  fitAll(box) {
    this.fit(box);
    this.least = this.scale;
  }
}

/** Places of all vertices on the screen's plane: `u` right, `v` up, `away` from the eye; only turning changes them. */
class Projection {
  constructor(scene, camera) {
    this.scene = scene;
    this.camera = camera;
    this.turned = -1;
    const count = scene.vertex[0].length;
    if (scene.dim === 2) {
      [this.u, this.v] = scene.vertex;
      this.away = null;
    } else {
      this.u = new Float32Array(count);
      this.v = new Float32Array(count);
      this.away = new Float32Array(count);
    }
  }

  refresh() {
    if (this.scene.dim === 2 || this.turned === this.camera.turned) return;
    this.turned = this.camera.turned;
    const [x, y, z] = this.scene.vertex;
    const [right, up, away] = this.camera.axes();
    for (let i = 0; i < x.length; i++) {
      this.u[i] = right[0] * x[i] + right[1] * y[i] + right[2] * z[i];
      this.v[i] = up[0] * x[i] + up[1] * y[i] + up[2] * z[i];
      this.away[i] = away[0] * x[i] + away[1] * y[i] + away[2] * z[i];
    }
  }

  /** Box around the vertices and, in the plane, around the map. */
  box() {
    this.refresh();
    const box = [Infinity, -Infinity, Infinity, -Infinity];
    const grow = (x, y) => {
      if (!(Math.abs(x) + Math.abs(y) < Infinity)) return; // a solve that failed may leave anything
      box[0] = Math.min(box[0], x);
      box[1] = Math.max(box[1], x);
      box[2] = Math.min(box[2], y);
      box[3] = Math.max(box[3], y);
    };
    for (let i = 0; i < this.u.length; i++) grow(this.u[i], this.v[i]);
    const grid = this.scene.grid;
    if (grid) {
      grow(grid.origin[0], grid.origin[1]);
      grow(grid.origin[0] + grid.cols * grid.resolution, grid.origin[1] + grid.rows * grid.resolution);
    }
    return box[0] <= box[1] ? box : [-1, 1, -1, 1];
  }
}
