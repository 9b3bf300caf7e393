// The layers of the map, and the ground on which they are drawn: kept as a picture, so that moving the map copies it.

const CHI2_95 = { 2: 5.991464547107979, 3: 7.814727903251179 };
const ROLES = ['odometry', 'observation', 'loop', 'prior', 'marginal'];
const BELIEVED = 'confirmed';

/** Dashes of layers that are drawn broken, by their mark; the list of layers shows them alike. */
const DASHES = { dash: [7, 4], dots: [1.5, 4], 'dash-dot': [8, 3, 1.5, 3] };

/** Layer of a closure: those that are redundant were not turned down. */
const closureLayer = ({ verdict }) => (verdict === BELIEVED ? 'closures' : verdict === 'redundant' ? 'redundant' : 'turned-down');

/** Half axes and direction of the 95 % region of a vertex as seen on the screen, metres; `c` is xx, xy, x3, yy, y3, 33. */
function ellipseOf(c, camera) {
  let [a, b, d] = [c[0], c[1], c[3]];
  if (camera.dim === 3) {
    const [right, up] = camera.axes();
    const times = (p, q) => p[0] * (c[0] * q[0] + c[1] * q[1] + c[2] * q[2])
      + p[1] * (c[1] * q[0] + c[3] * q[1] + c[4] * q[2]) + p[2] * (c[2] * q[0] + c[4] * q[1] + c[5] * q[2]);
    [a, b, d] = [times(right, right), times(right, up), times(up, up)];
  }
  const mean = (a + d) / 2, half = Math.hypot((a - d) / 2, b), k = Math.sqrt(CHI2_95[camera.dim]);
  return { major: k * Math.sqrt(Math.max(mean + half, 0)), minor: k * Math.sqrt(Math.max(mean - half, 0)),
    angle: 0.5 * Math.atan2(2 * b, a - d) };
}

class Layers {
  constructor(scene, grid, projection) {
    this.scene = scene;
    this.projection = projection;
    this.magnify = 1;
    /** @type {{id: string, label: string, on: boolean, count: number, mark: string, colour: () => string, draw: Function}[]} */
    this.list = [];
    if (grid) this.add('grid', 'map', true, 0, 'box', () => colours.ink, (context, camera) => grid.draw(context, camera));
    this.edges(scene);
    this.paths(scene);
    this.closures(scene);
    this.points(scene);
  }

  add(id, label, on, count, mark, colour, draw) {
    this.list.push({ id, label, on, count, mark, colour, draw });
  }

  get(id) { return this.list.find((layer) => layer.id === id); }
  shows(id) { return Boolean(this.get(id)?.on); }

  paths(scene) {
    const width = (kind) => (kind === 'trajectory' ? 1.8 : 1.4);
    for (const kind of ['odometry', 'truth', 'trajectory']) {
      const mine = scene.paths.filter((path) => path.kind === kind);
      if (!mine.length) continue;
      const lines = mine.map((path) => ({ path, line: new Polyline(path.x, path.y, path.time) }));
      const label = { odometry: 'odometry alone', truth: 'truth', trajectory: 'path' }[kind];
      const colour = () => (kind === 'trajectory' ? colourOf(0) : colours[kind]);
      this.add(kind, label, kind !== 'truth', 0, kind === 'trajectory' ? 'line' : 'dash', colour, (context, camera, until) => {
        context.lineWidth = width(kind);
        context.setLineDash(kind === 'odometry' ? [7, 5] : kind === 'truth' ? [2, 4] : []);
        for (const { path, line } of lines) {
          context.strokeStyle = kind === 'trajectory' ? colourOf(path.robot) : colour();
          line.stroke(context, camera, until);
        }
        context.setLineDash([]);
      });
    }
  }

  /** Edges by role; odometry by robot, for there it is the path. */
  edges(scene) {
    const { ends, role, born, weight } = scene.edges;
    const rows = { observation: [], odometry: [], loop: [], prior: [], marginal: [], doubted: [] };
    for (let e = 0; e < role.length; e++) rows[weight[e] < 0.5 ? 'doubted' : ROLES[role[e]]].push(e);
    const dense = scene.paths.some((path) => path.kind === 'trajectory');
    const simple = (id, label, on, alpha, width, mark = 'line') => {
      if (!rows[id].length) return;
      const lines = new Segments(ends, rows[id], born);
      this.add(id, label, on, rows[id].length, mark, () => colours[id], (context, camera, until) => {
        context.globalAlpha = alpha;
        context.lineWidth = width;
        context.strokeStyle = colours[id];
        context.setLineDash(DASHES[mark] ?? []);
        lines.stroke(context, camera, this.projection, until);
        context.setLineDash([]);
        context.globalAlpha = 1;
      });
    };
    simple('observation', 'sightings of landmarks', true, Math.min(0.4, 12 / Math.sqrt(rows.observation.length)), 1);
    simple('loop', dense ? 'scans aligned with each other' : 'loop edges', !dense, dense ? 0.35 : 0.7, 1);
    simple('marginal', 'what pruned keyframes knew', false, 0.5, 1);
    if (rows.odometry.length) {
      const byRobot = scene.robots.map((_, robot) => new Segments(ends,
        rows.odometry.filter((e) => scene.robot[ends[2 * e]] === robot), born));
      this.add(dense ? 'steps' : 'odometry-edges', dense ? 'steps of the graph' : 'path (odometry edges)', !dense,
        rows.odometry.length, 'line', () => colourOf(0), (context, camera, until) => {
          context.lineWidth = dense ? 1 : 1.5;
          byRobot.forEach((lines, robot) => {
            context.strokeStyle = colourOf(robot);
            lines.stroke(context, camera, this.projection, until);
          });
        });
    }
    simple('doubted', 'doubted by the robust kernel', !dense, 0.9, 1.2, 'dash-dot');
  }

  closures(scene) {
    if (!scene.closures.length) return;
    const ends = Int32Array.from(scene.closures.flatMap((closure) => [closure.target, closure.source]));
    const born = Float32Array.from(scene.closures, (closure) => scene.time[closure.source]);
    this.middles = new Float32Array(ends.length);
    for (const [id, label, mark] of [['turned-down', 'closures turned down', 'dots'],
      ['redundant', 'closures that say the same', 'dash'], ['closures', 'loop closures', 'line']]) {
      const wanted = id === 'closures';
      const mine = [...scene.closures.keys()].filter((k) => closureLayer(scene.closures[k]) === id);
      if (!mine.length) continue;
      const lines = new Segments(ends, mine, born), colour = () => (wanted ? colours.loop : colours.rejected);
      this.add(id, label, wanted, mine.length, mark, colour, (context, camera, until) => {
        context.strokeStyle = colour();
        context.fillStyle = colour();
        context.lineWidth = wanted ? 1.5 : 1;
        context.globalAlpha = wanted ? 0.95 : 0.7;
        context.setLineDash(DASHES[mark] ?? []);
        lines.stroke(context, camera, this.projection, until);
        context.setLineDash([]);
        const [mx, my] = this.middlesOf(ends);
        const until_ = after(lines.born, until);
        const size = Math.min(4.5, Math.max(2, camera.scale / 9));
        fillPoints(context, camera, mx, my, lines.rows.subarray(0, until_), size, diamond);
        context.globalAlpha = 1;
      });
    }
    this.closureEnds = ends;
  }

  /** Middles of the closures, where they are clicked. */
  middlesOf(ends = this.closureEnds) {
    const { u, v } = this.projection, count = ends.length / 2;
    if (!this.middleX) [this.middleX, this.middleY] = [new Float32Array(count), new Float32Array(count)];
    for (let k = 0; k < count; k++) {
      this.middleX[k] = (u[ends[2 * k]] + u[ends[2 * k + 1]]) / 2;
      this.middleY[k] = (v[ends[2 * k]] + v[ends[2 * k + 1]]) / 2;
    }
    return [this.middleX, this.middleY];
  }

  points(scene) {
    const { projection } = this;
    const poses = Int32Array.from({ length: scene.count }, (_, i) => i).sort((a, b) => scene.time[a] - scene.time[b] || a - b);
    const born = Float32Array.from(poses, (i) => scene.time[i]);
    this.poses = poses;
    this.born = born;
    this.add('poses', 'poses of the graph', false, scene.count, 'dot', () => colours.ink, (context, camera, until) => {
      context.fillStyle = colours.ink;
      fillPoints(context, camera, projection.u, projection.v, poses.subarray(0, after(born, until)), 1.6, square);
    });
    if (scene.marks) {
      const rows = Int32Array.from({ length: scene.marks }, (_, i) => scene.count + i);
      this.add('landmarks', 'landmarks', true, scene.marks, 'triangle', () => colours.landmark, (context, camera) => {
        context.fillStyle = colours.landmark;
        fillPoints(context, camera, projection.u, projection.v, rows, 5, triangle);
        this.label(context, camera, rows);
      });
    }
    if (scene.covariance || scene.mark.covariance) {
      this.add('ellipses', '95 % ellipses', !this.drowns(scene), 0, 'ring', () => colours.ellipse, (context, camera, until) => {
        context.strokeStyle = colours.ellipse;
        context.lineWidth = 1.2;
        this.ellipses(context, camera, until);
      });
    }
  }

  /** Whether most ellipses are so large that nothing else could be seen. */
  drowns(scene) {
    if (!scene.covariance) return false;
    const box = this.projection.box(), extent = Math.max(box[1] - box[0], box[3] - box[2]);
    const radius = Array.from({ length: scene.count }, (_, i) => ellipseOf(scene.covariance.subarray(6 * i, 6 * i + 6), this.projection.camera).major);
    return radius.sort((a, b) => a - b)[scene.count >> 1] > 0.1 * extent;
  }

  label(context, camera, rows) {
    context.font = '12px ui-sans-serif, system-ui, sans-serif';
    context.textBaseline = 'middle';
    context.strokeStyle = colours.halo;
    context.lineWidth = 3;
    context.lineJoin = 'round';
    const taken = new Set(); // cells of the screen with a label; one that would cover another is left out
    for (const i of rows) {
      const x = camera.toScreenX(this.projection.u[i]) + 8, y = camera.toScreenY(this.projection.v[i]) - 7;
      if (x < 0 || y < 0 || x > camera.width || y > camera.height) continue;
      const name = this.scene.mark.name[i - this.scene.count], row = Math.floor(y / 15);
      const cells = [];
      for (let c = Math.floor(x / 10); c <= Math.floor((x + 8 * name.length) / 10); c++) cells.push(c * 4096 + row, c * 4096 + row + 1);
      if (cells.some((cell) => taken.has(cell))) continue;
      cells.forEach((cell) => taken.add(cell));
      context.strokeText(name, x, y);
      context.fillText(name, x, y);
    }
  }

  /** Ellipses of poses and landmarks; the larger they are on the screen, the fewer are drawn. */
  ellipses(context, camera, until) {
    const { scene, projection, magnify } = this, taken = new Set();
    const one = (x, y, covariance, apart) => {
      const { major, minor, angle } = ellipseOf(covariance, camera), k = camera.scale * magnify;
      if (major * k < 0.8) return;
      const octave = Math.ceil(Math.log2(Math.max(apart, 1.2 * major * k))), cell = 2 ** octave;
      const place = (octave * 4096 + Math.floor(x / cell)) * 4096 + Math.floor(y / cell);
      if (taken.has(place)) return;
      taken.add(place);
      context.moveTo(x + major * k * Math.cos(angle), y - major * k * Math.sin(angle));
      context.ellipse(x, y, major * k, Math.max(minor * k, 0.3), -angle, 0, 2 * Math.PI);
      if (++drawn % 50 === 0) {
        context.stroke();
        context.beginPath();
      }
    };
    let drawn = 0;
    context.beginPath();
    if (scene.covariance) {
      const last = after(this.born, until);
      for (let n = 0; n < last; n++) {
        const i = this.poses[n], x = camera.toScreenX(projection.u[i]), y = camera.toScreenY(projection.v[i]);
        if (x < -60 || y < -60 || x > camera.width + 60 || y > camera.height + 60) continue;
        one(x, y, scene.covariance.subarray(6 * i, 6 * i + 6), 32);
      }
    }
    taken.clear();
    const marks = scene.mark.covariance;
    for (let m = 0; marks && camera.dim === 2 && m < scene.marks; m++) {
      const x = camera.toScreenX(projection.u[scene.count + m]), y = camera.toScreenY(projection.v[scene.count + m]);
      one(x, y, [marks[3 * m], marks[3 * m + 1], 0, marks[3 * m + 2], 0, 0], 8);
    }
    context.stroke();
  }

  draw(context, camera, until) {
    this.projection.refresh();
    for (const layer of this.list) if (layer.on) layer.draw(context, camera, until);
  }
}

/** The layers as a picture larger than the window; it is made anew when the map leaves it, is scaled or changes. */
class Ground {
  constructor(canvas, layers) {
    this.canvas = canvas;
    this.layers = layers;
    this.picture = document.createElement('canvas');
    this.made = null;
    this.cost = 0;
  }

  invalidate() { this.made = null; }

  /** Draw; returns whether the picture is a makeshift that wants another draw when all is at rest. */
  draw(camera, until, resting) {
    const ratio = window.devicePixelRatio || 1, context = this.canvas.getContext('2d');
    const made = this.made;
    const same = made && made.until === until && made.turned === camera.turned && made.ratio === ratio
      && made.width === camera.width && made.height === camera.height;
    let dx = 0, dy = 0, zoom = 1;
    if (same) {
      zoom = camera.scale / made.scale;
      dx = (made.x - camera.x) * camera.scale;
      dy = (camera.y - made.y) * camera.scale;
    }
    const outside = !same || Math.abs(dx) > made.margin || Math.abs(dy) > made.margin;
    const stale = outside || zoom !== 1;
    const reach = this.cost > 60 ? 4 : 2; // how far a picture that is costly to make is stretched meanwhile
    const makeshift = same && zoom !== 1 && !resting && this.cost > 12 && zoom > 1 / reach && zoom < reach;
    if (stale && !makeshift) {
      this.make(camera, until, ratio, until === Infinity);
      dx = dy = 0;
      zoom = 1;
    }
    const { margin } = this.made, w = (camera.width + 2 * margin) * zoom, h = (camera.height + 2 * margin) * zoom;
    context.setTransform(ratio, 0, 0, ratio, 0, 0);
    context.clearRect(0, 0, camera.width, camera.height);
    if (zoom === 1) { // whole pixels, so that copying is all there is to do
      dx = Math.round(dx * ratio) / ratio;
      dy = Math.round(dy * ratio) / ratio;
    }
    context.drawImage(this.picture, (camera.width - w) / 2 + dx, (camera.height - h) / 2 + dy, w, h);
    return makeshift;
  }

  make(camera, until, ratio, roomy) {
    const begun = performance.now();
    const margin = roomy ? Math.round(Math.min(camera.width, camera.height) * 0.3) : 0;
    const width = camera.width + 2 * margin, height = camera.height + 2 * margin;
    if (this.picture.width !== Math.round(width * ratio) || this.picture.height !== Math.round(height * ratio)) {
      this.picture.width = Math.round(width * ratio);
      this.picture.height = Math.round(height * ratio);
    }
    const wide = Object.create(camera);
    wide.width = width;
    wide.height = height;
    const context = this.picture.getContext('2d');
    context.setTransform(ratio, 0, 0, ratio, 0, 0);
    context.clearRect(0, 0, width, height);
    context.lineJoin = 'round';
    context.lineCap = 'butt';
    this.layers.draw(context, wide, until);
    this.made = { x: camera.x, y: camera.y, scale: camera.scale, turned: camera.turned, width: camera.width,
      height: camera.height, until, ratio, margin };
    this.cost = performance.now() - begun;
  }
}
