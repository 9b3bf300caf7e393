// The panel beside the map: what is known of the selection. Text is set as text, never as HTML.

/** An element with text or children. */
function make(tag, attributes = {}, ...children) {
  const element = document.createElement(tag);
  for (const [name, value] of Object.entries(attributes)) {
    if (name.startsWith('on')) element.addEventListener(name.slice(2), value);
    else if (value !== null) element.setAttribute(name, value);
  }
  element.append(...children);
  return element;
}

const facts = (rows) => make('dl', {}, ...rows.map(([name, value]) => make('div', {}, make('dt', {}, name), make('dd', {}, value))));

function metres(length) {
  const size = Math.abs(length);
  if (size >= 100) return `${length.toFixed(0)} m`;
  if (size >= 1) return `${length.toFixed(2)} m`;
  return size >= 0.01 ? `${(100 * length).toFixed(1)} cm` : `${(1000 * length).toFixed(1)} mm`;
}
const degrees = (angle) => `${(angle * 180 / Math.PI).toFixed(Math.abs(angle) < 0.02 ? 2 : 1)}°`;
const percent = (share) => (share === null ? '-' : `${(100 * share).toFixed(0)} %`);
const wrap = (angle) => Math.atan2(Math.sin(angle), Math.cos(angle));

/** A moment in words. */
function when(scene, moment) {
  return scene.timed ? `${moment.toFixed(1)} s` : `step ${Math.round(moment)}`;
}

/** Pose of b seen from a. */
function between(a, b) {
  const [c, s, dx, dy] = [Math.cos(a[2]), Math.sin(a[2]), b[0] - a[0], b[1] - a[1]];
  return [c * dx + s * dy, -s * dx + c * dy, wrap(b[2] - a[2])];
}

/** Points of a scan at a pose: x, y, x, y, ... */
function placed(points, T) {
  const [c, s] = [Math.cos(T[2]), Math.sin(T[2])], out = new Float32Array(points.length);
  for (let k = 0; k < points.length; k += 2) {
    out[k] = T[0] + c * points[k] - s * points[k + 1];
    out[k + 1] = T[1] + s * points[k] + c * points[k + 1];
  }
  return out;
}

/** Box around the robots and nearly all returns of scans; a few far ones shall not make all others small. */
function boxOf(items) {
  return [0, 1].flatMap((axis) => {
    const values = items.flatMap(({ points, T }) => [...placed(points, T).filter((_, k) => k % 2 === axis)]).sort((p, q) => p - q);
    const cut = Math.floor(values.length * 0.03), robots = items.map(({ T }) => T[axis]);
    return [Math.min(values[cut] ?? 0, ...robots), Math.max(values[values.length - 1 - cut] ?? 0, ...robots)];
  });
}

/** Draw scans, each at a pose in one frame; what the box holds is seen. */
function drawScans(canvas, items, box) {
  const ratio = window.devicePixelRatio || 1, side = canvas.clientWidth || 150;
  canvas.width = canvas.height = Math.round(side * ratio);
  const context = canvas.getContext('2d');
  const camera = new Camera(2);
  [camera.width, camera.height] = [side, side];
  camera.fit(box, 0.07);
  context.scale(ratio, ratio);
  context.strokeStyle = colours.grid;
  context.lineWidth = 1;
  context.beginPath();
  for (let m = -200; m <= 200; m += 5) {
    const [x, y] = [Math.round(camera.toScreenX(m)) + 0.5, Math.round(camera.toScreenY(m)) + 0.5];
    context.moveTo(x, 0);
    context.lineTo(x, side);
    context.moveTo(0, y);
    context.lineTo(side, y);
  }
  if (camera.scale > 1.5) context.stroke();
  for (const { points, T, colour } of items) {
    const out = placed(points, T);
    context.fillStyle = colour;
    context.globalAlpha = 0.85;
    for (let k = 0; k < out.length; k += 2) context.fillRect(camera.toScreenX(out[k]) - 0.9, camera.toScreenY(out[k + 1]) - 0.9, 1.8, 1.8);
    context.globalAlpha = 1;
    context.beginPath();
    context.arc(camera.toScreenX(T[0]), camera.toScreenY(T[1]), 3.5, 0, 2 * Math.PI);
    context.fill();
  }
}

class Inspector {
  /** @param {(selection: object | null, move: boolean) => void} select */
  constructor(panel, scene, select) {
    this.panel = panel;
    this.scene = scene;
    this.select = select;
    this.edgesOf = null;
  }

  show(selection) {
    this.redraw = () => {};
    const content = selection ? this[selection.kind](selection) : this.nothing();
    this.panel.replaceChildren(...content.filter(Boolean));
    this.redraw();
  }

  link(selection, text = nameOf(this.scene, selection)) {
    return make('button', { type: 'button', class: 'show', onclick: () => this.select(selection, true) }, text);
  }

  nothing() {
    const { scene } = this;
    const believed = scene.closures.filter((closure) => closure.verdict === BELIEVED).length;
    const input = make('input', { type: 'search', placeholder: 'pose number', 'aria-label': 'Number of a pose', inputmode: 'numeric' });
    const form = make('form', { onsubmit: (event) => {
      event.preventDefault();
      const row = scene.name.slice(0, scene.count).indexOf(input.value.trim());
      if (row >= 0) this.select({ kind: 'pose', row, last: -1 }, true);
      else input.setCustomValidity('There is no pose of that number.'), input.reportValidity();
    }, oninput: () => input.setCustomValidity('') }, input, make('button', { type: 'submit', class: 'show' }, 'Go'));
    return [
      make('h2', {}, 'Nothing selected'),
      make('p', { class: 'sub' }, 'Click a pose' + (scene.marks ? ', a landmark' : '') + (scene.closures.length
        ? ' or the diamond in the middle of a loop closure' : ' or an edge') + ' to see what is known of it.'),
      believed ? make('p', {}, this.link({ kind: 'closure', row: scene.closures.findIndex((c) => c.verdict === BELIEVED), last: -1 },
        'Go through the closures one by one')) : null,
      scene.count ? form : null,
      this.legend(),
    ];
  }

  /** Which colour is which robot. */
  legend() {
    if (this.scene.robots.length < 2) return null;
    return facts(this.scene.robots.map((name, robot) => [
      make('span', {}, make('span', { class: 'swatch', style: `background:${colourOf(robot)}` }), name),
      `${this.scene.robot.filter((r) => r === robot).length.toLocaleString('en')} poses`]));
  }

  pose({ row }) {
    const { scene } = this, [x, y, z] = scene.vertex.map((axis, c) => axis[row] + scene.centre[c]);
    const rows = [[scene.timed ? 'time' : 'place in the path', when(scene, scene.time[row])]];
    if (scene.robots.length > 1) rows.push(['robot', scene.robots[scene.robot[row]]]);
    rows.push(['x, y' + (scene.dim === 3 ? ', z' : ''), [x, y, z].slice(0, scene.dim).map((v) => v.toFixed(2)).join(', ') + ' m']);
    if (scene.dim === 2) rows.push(['heading', degrees(scene.heading[row])]);
    const canvas = scene.scans && make('canvas', { class: 'scan', role: 'img', 'aria-label': 'Scan of this pose' });
    if (canvas) {
      const items = [{ points: scene.scans.of(row), T: [0, 0, Math.PI / 2], colour: colours.scan }];
      this.redraw = () => drawScans(canvas, items, boxOf(items));
    }
    return [make('h2', {}, `Pose ${scene.name[row]}`), facts(rows), ...this.uncertainty(row), canvas,
      canvas && make('p', { class: 'sub' }, 'Its scan; the robot looks up. Lines are 5 m apart.'), ...this.around(row), this.nav()];
  }

  uncertainty(row) {
    const { scene } = this;
    if (!scene.covariance) return [make('p', { class: 'sub' }, 'There is no covariance: the measurements leave something free.')];
    const c = scene.covariance.subarray(6 * row, 6 * row + 6), sd = (k) => Math.sqrt(Math.max(c[k], 0));
    if (sd(0) + sd(3) + sd(5) === 0) return [make('p', { class: 'sub' }, 'This pose is held in place; all others are seen from it.')];
    const third = scene.dim === 2 ? 'heading' : 'z', unit = scene.dim === 2 ? degrees : metres;
    const off = (k, a, b) => (sd(a) && sd(b) ? (c[k] / sd(a) / sd(b)).toFixed(2) : '-');
    const rows = [['x', `±${metres(1.96 * sd(0))}`], ['y', `±${metres(1.96 * sd(3))}`], [third, `±${unit(1.96 * sd(5))}`],
      ['correlation x y', off(1, 0, 3)], [`correlation x ${third}`, off(2, 0, 5)], [`correlation y ${third}`, off(4, 3, 5)]];
    if (scene.dim === 2) {
      const flat = ellipseOf(c, { dim: 2 });
      rows.push(['95 % ellipse', `${metres(2 * flat.major)} by ${metres(2 * flat.minor)}`]);
    }
    return [make('h3', {}, 'How sure (95 %, in the axes of the map)'), facts(rows)];
  }

  /** Closures and edges at a pose. */
  around(row) {
    const { scene } = this, out = [];
    const closures = [...scene.closures.keys()].filter((k) => scene.closures[k].source === row || scene.closures[k].target === row);
    if (closures.length) {
      out.push(make('h3', {}, 'Closures here'), facts(closures.slice(0, 6).map((k) => [
        this.link({ kind: 'closure', row: k, last: -1 }), { closures: 'believed', redundant: 'not needed', 'turned-down': 'turned down' }[closureLayer(scene.closures[k])]])));
    }
    const edges = this.edgesAt(row).sort((a, b) => scene.edges.squared[b] - scene.edges.squared[a]);
    if (edges.length) {
      out.push(make('h3', {}, `${edges.length} measurements here, worst first`), facts(edges.slice(0, 6).map((e) => [
        this.link({ kind: 'edge', row: e, last: -1 }), `${Math.sqrt(scene.edges.squared[e]).toFixed(2)} σ`])));
    }
    return out;
  }

  edgesAt(vertex) {
    const { ends, role } = this.scene.edges, found = [];
    for (let e = 0; e < role.length; e++) if (ends[2 * e] === vertex || ends[2 * e + 1] === vertex) found.push(e);
    return found;
  }

  landmark({ row }) {
    const { scene } = this, i = scene.count + row, marks = scene.mark.covariance;
    const rows = [['seen', `${scene.mark.sightings[row].toLocaleString('en')} times`],
      ['x, y' + (scene.dim === 3 ? ', z' : ''), scene.vertex.map((axis, c) => (axis[i] + scene.centre[c]).toFixed(2)).join(', ') + ' m']];
    if (marks && scene.dim === 2) {
      const flat = ellipseOf([marks[3 * row], marks[3 * row + 1], 0, marks[3 * row + 2], 0, 0], { dim: 2 });
      rows.push(['x', `±${metres(1.96 * Math.sqrt(marks[3 * row]))}`], ['y', `±${metres(1.96 * Math.sqrt(marks[3 * row + 2]))}`],
        ['95 % ellipse', `${metres(2 * flat.major)} by ${metres(2 * flat.minor)}`]);
    }
    return [make('h2', {}, `Landmark ${scene.mark.name[row]}`), facts(rows), ...this.around(i), this.nav()];
  }

  edge(selection) {
    const { scene } = this, e = selection.row, { ends, role, squared, weight } = scene.edges;
    const end = (i) => this.link(i < scene.count ? { kind: 'pose', row: i, last: -1 } : { kind: 'landmark', row: i - scene.count, last: -1 });
    return [make('h2', {}, nameOf(scene, selection)), facts([['from', end(ends[2 * e])], ['to', end(ends[2 * e + 1])],
      ['kind', ROLES[role[e]]], ['residual', `${Math.sqrt(squared[e]).toFixed(2)} standard deviations`],
      ['robust weight', weight[e].toFixed(2)]]),
    make('p', { class: 'sub' }, squared[e] > 9 ? 'It misses by far more than its stated noise explains.'
      : squared[e] > 4 ? 'It misses by more than usual.' : 'It fits as well as its stated noise lets expect.'), this.nav()];
  }

  span({ row, last }) {
    const { scene } = this;
    let way = 0;
    for (let i = row; i < last; i++) way += Math.hypot(...scene.vertex.map((axis) => axis[i + 1] - axis[i]));
    return [make('h2', {}, nameOf(scene, { kind: 'span', row, last })), facts([['from', when(scene, scene.time[row])],
      ['to', when(scene, scene.time[last])], ['way', metres(way)]]),
    make('p', {}, this.link({ kind: 'pose', row, last: -1 }), ' · ', this.link({ kind: 'pose', row: last, last: -1 })), this.nav()];
  }

  closure({ row }) {
    const { scene } = this, closure = scene.closures[row], believed = closure.verdict === BELIEVED;
    const { source, target } = closure;
    const poseOf = (i) => [scene.vertex[0][i], scene.vertex[1][i], scene.heading[i]];
    const now = between(poseOf(target), poseOf(source));
    const apart = closure.measured && between(now, closure.measured);
    const matched = closure.overlap > 0; // otherwise the search found no pose worth aligning
    const layer = closureLayer(closure), group = [...scene.closures.keys()].filter((k) => closureLayer(scene.closures[k]) === layer);
    const fate = { closures: 'believed', redundant: 'not needed', 'turned-down': 'turned down' }[layer];
    const place = group.indexOf(row);
    const kinds = [['before', closure.predicted, 'Before: where the graph expected it'],
      ['after', believed ? now : matched && closure.measured, believed ? 'After: in the map' : 'As matched, had it been believed']];
    const kept = [source, target].filter((i) => scene.scans?.has(i));
    const views = kept.length > 0 && make('div', { class: 'pair' }, ...kinds.map(([id, T, caption]) => make('figure', {},
      make('canvas', { 'data-overlay': id, role: 'img', 'aria-label': `Both scans. ${caption}` }),
      make('figcaption', {}, T ? caption : id === 'before' ? 'Nothing was expected' : 'No single pose was found'))));
    if (views) {
      const both = (T) => [{ points: scene.scans.of(target), T: [0, 0, 0], colour: colours.scan },
        ...(T ? [{ points: scene.scans.of(source), T, colour: colours.other }] : [])];
      const box = boxOf(both(kinds[1][1] || kinds[0][1])); // the same for both, so that they can be compared
      this.redraw = () => kinds.forEach(([id, T]) => drawScans(views.querySelector(`[data-overlay=${id}]`), both(T), box));
    }
    const gone = scene.scans ? [source, target].filter((i) => !kept.includes(i)).map((i) => scene.name[i]) : [];
    const end = (i) => (i < scene.count ? this.link({ kind: 'pose', row: i, last: -1 }) : `${scene.name[i]}, summarised`);
    const swatch = (colour) => make('span', { class: 'swatch', style: `background:${colour}` });
    const step = (by) => this.select({ kind: 'closure', row: group[(place + by + group.length) % group.length], last: -1 }, true);
    return [
      make('h2', {}, nameOf(scene, { kind: 'closure', row })),
      make('p', { class: `verdict ${believed ? 'good' : 'bad'}` }, 
        believed ? 'Believed' : `${layer === 'redundant' ? 'Not needed' : 'Turned down'}: ${closure.reason}`),
      views,
      make('p', { class: 'sub' }, swatch(colours.other), `scan at ${when(scene, scene.time[source])}  `, swatch(colours.scan),
        `the older one, at ${when(scene, scene.time[target])}`),
      gone.length ? make('p', { class: 'sub' }, `Not kept: the scan${gone.length > 1 ? 's' : ''} of ${gone.join(' and ')}. Enough other keyframes have seen the same, so that `
        + `${gone.length > 1 ? 'they were' : 'it was'} summarised; the evidence is from the moment of the match.`) : null,
      make('h3', {}, 'The evidence'),
      facts([
        ['places look alike', percent(closure.similarity)],
        ['returns likely at the match', percent(closure.likelihood)],
        ...(matched ? [['returns with a partner', percent(closure.overlap)],
          ['distance of partners (RMS)', metres(closure.rms)],
          ['returns in free space', percent(closure.contradiction)],
          ['older surfaces seen through', percent(closure.seen_through)],
          ['next best pose, as a share', percent(closure.rival)],
          ...(closure.telling ? [['returns that tell it from the next places along', closure.telling.toLocaleString('en')]] : []),
          ...(closure.in_row ? [['matches in a row that tell where along', closure.in_row.toLocaleString('en')]] : []),
          ...(closure.within ? [['known along to (two deviations)', metres(closure.within)]] : []),
          ['moved from what was expected', `${metres(closure.innovation[0])}, ${degrees(closure.innovation[1])}`],
          ...(closure.distance > 0 ? [['as the graph measures it', `${Math.sqrt(closure.distance).toFixed(1)} σ`]] : []),
          ...(believed || closure.supporters ? [['closures elsewhere that agree', closure.supporters.toLocaleString('en')]] : [])] : []),
        ...(believed && apart ? [['match and map differ by', `${metres(Math.hypot(apart[0], apart[1]))}, ${degrees(apart[2])}`]] : []),
        ['from', end(source)], ['to', end(target)],
      ]),
      make('p', { class: 'sub' }, `${place + 1} of ${group.length} ${fate}`),
      this.nav(make('button', { type: 'button', onclick: () => step(-1) }, 'Previous'),
        make('button', { type: 'button', onclick: () => step(1) }, 'Next')),
    ];
  }

  nav(...buttons) {
    return make('div', { class: 'nav' }, ...buttons, make('button', { type: 'button', onclick: () => this.select(null, false) }, 'Close'));
  }
}
