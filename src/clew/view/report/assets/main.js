// Everything put together: sizes, pointer, keys, layers, theme.

const raw = JSON.parse(byId('report-data').textContent);
const scene = readScene(raw);
const map = byId('map'), stage = byId('stage');
const camera = new Camera(scene.dim);
const projection = new Projection(scene, camera);
const grid = scene.grid && new Grid(scene.grid, () => { ground.invalidate(); request(); });
const layers = new Layers(scene, grid, projection);
const ground = new Ground(byId('ground'), layers);
const overlay = new Overlay(map, scene, layers);
const timeline = new Timeline(scene, () => { request(); drawCharts(); });
const inspector = new Inspector(byId('inspector'), scene, (selection, move) => select(selection, move));
const charts = [...document.querySelectorAll('[data-chart]')].map((canvas) => new Chart(canvas, raw.charts[canvas.dataset.chart], scene,
  (moment) => { timeline.pause(); timeline.set(moment); }));
let selection = null, pending = false, restTimer = 0, moving = false;
const space = scene.dim === 3;
const still = window.matchMedia('(prefers-reduced-motion: reduce)');

// --- drawing -------------------------------------------------------------------------------------------------------

function request() {
  if (!pending) {
    pending = true;
    requestAnimationFrame(draw);
  }
}

function draw() {
  pending = false;
  const rough = ground.draw(camera, timeline.until, moving ? false : 'rest');
  overlay.draw(camera, timeline.moment, selection);
  drawScale();
  if (rough || moving) {
    clearTimeout(restTimer);
    restTimer = setTimeout(() => { moving = false; request(); }, 140);
  }
  if (!document.documentElement.dataset.drawn && (!grid || grid.levels.length)) {
    document.documentElement.dataset.drawn = String(Math.round(performance.now()));
  }
}

function drawScale() {
  const most = Math.min(150, camera.width / 4) / camera.scale, power = 10 ** Math.floor(Math.log10(most));
  const length = [5, 2, 1].map((k) => k * power).find((value) => value <= most) || power;
  byId('scale-bar').style.width = `${length * camera.scale}px`;
  byId('scale-text').textContent = length >= 1000 ? `${length / 1000} km` : length >= 1 ? `${length} m` : `${Math.round(length * 100)} cm`;
}

const drawCharts = () => charts.forEach((chart) => chart.draw(timeline.moment));

function resize() {
  const width = stage.clientWidth, height = stage.clientHeight, ratio = window.devicePixelRatio || 1;
  const first = camera.width === 1;
  [camera.width, camera.height] = [width, height];
  for (const canvas of [map, byId('ground')]) {
    canvas.width = Math.round(width * ratio);
    canvas.height = Math.round(height * ratio);
  }
  if (first) camera.fitAll(projection.box());
  ground.invalidate();
  draw();
  drawCharts();
}

function look(change) {
  moving = true;
  change();
  request();
}

// --- selection -----------------------------------------------------------------------------------------------------

function select(next, move) {
  selection = next;
  inspector.show(next);
  byId('status').textContent = next ? `${nameOf(scene, next)} selected` : 'Nothing selected';
  if (next && move) bringIntoView(next);
  request();
}

/** Move the map, and on a page that is scrolled away the page, so that a selection is seen. */
function bringIntoView(next) {
  projection.refresh();
  const rows = verticesOf(scene, next);
  let box = [Infinity, -Infinity, Infinity, -Infinity];
  for (const i of rows) {
    const [x, y] = [projection.u[i], projection.v[i]];
    box = [Math.min(box[0], x), Math.max(box[1], x), Math.min(box[2], y), Math.max(box[3], y)];
  }
  const room = (next.kind === 'span' ? 0.35 : 1) * (scene.grid ? 6 : 20 / camera.least); // of a map as far as a laser sees
  const around = Math.max(room, 0.25 * Math.max(box[1] - box[0], box[3] - box[2]));
  if (next.kind === 'closure' || next.kind === 'span' || next.kind === 'edge') {
    camera.fit([box[0] - around, box[1] + around, box[2] - around, box[3] + around]);
  } else {
    [camera.x, camera.y] = [(box[0] + box[1]) / 2, (box[2] + box[3]) / 2];
    camera.scale = Math.max(camera.scale, camera.least * 3);
  }
  const born = Math.max(...rows.map((i) => scene.time[i]));
  if (born > timeline.moment) timeline.set(born);
  const place = byId('workbench').getBoundingClientRect();
  if (place.top < 0 || place.bottom > window.innerHeight) {
    byId('workbench').scrollIntoView({ block: 'start', behavior: still.matches ? 'auto' : 'smooth' });
  }
}

/** Go to the next or previous closure of the kind that is selected; believed ones at first. */
function stepClosure(by) {
  if (!scene.closures.length) return;
  const present = selection?.kind === 'closure' ? selection.row : null;
  const layer = present === null ? 'closures' : closureLayer(scene.closures[present]);
  let group = [...scene.closures.keys()].filter((k) => closureLayer(scene.closures[k]) === layer);
  if (!group.length) group = [...scene.closures.keys()];
  const at = present === null ? (by > 0 ? -1 : 0) : group.indexOf(present);
  select({ kind: 'closure', row: group[(at + by + group.length) % group.length], last: -1 }, true);
}

// --- pointer -------------------------------------------------------------------------------------------------------

const fingers = new Map();
let pressed = null;

function placeOf(event) {
  const box = map.getBoundingClientRect();
  return [event.clientX - box.left, event.clientY - box.top];
}

map.addEventListener('pointerdown', (event) => {
  map.setPointerCapture(event.pointerId);
  fingers.set(event.pointerId, placeOf(event));
  pressed = { moved: 0, shift: event.shiftKey || event.button !== 0 };
  hover(null);
});

map.addEventListener('pointermove', (event) => {
  const place = placeOf(event), before = fingers.get(event.pointerId);
  if (!before) {
    hover(pick(scene, layers, camera, ...place, timeline.until), place);
    return;
  }
  const dx = place[0] - before[0], dy = place[1] - before[1];
  pressed.moved += Math.abs(dx) + Math.abs(dy);
  if (fingers.size === 2) {
    const [other] = [...fingers].filter(([id]) => id !== event.pointerId).map(([, at]) => at);
    const zoom = Math.hypot(place[0] - other[0], place[1] - other[1]) / (Math.hypot(before[0] - other[0], before[1] - other[1]) || 1);
    look(() => {
      camera.pan(dx / 2, dy / 2);
      camera.zoom(zoom, (place[0] + other[0]) / 2, (place[1] + other[1]) / 2);
    });
  } else if (pressed.moved > 4) {
    look(() => (space && !pressed.shift ? camera.turn(-dx * 0.008, dy * 0.008) : camera.pan(dx, dy)));
  }
  fingers.set(event.pointerId, place);
});

function release(event) {
  const single = fingers.size === 1 && fingers.has(event.pointerId);
  fingers.delete(event.pointerId);
  if (event.type === 'pointerup' && single && pressed && pressed.moved <= 4) {
    select(pick(scene, layers, camera, ...placeOf(event), timeline.until, event.pointerType === 'touch' ? 22 : 11), false);
  }
}
map.addEventListener('pointerup', release);
map.addEventListener('pointercancel', release);
map.addEventListener('pointerleave', () => hover(null));
map.addEventListener('contextmenu', (event) => { if (space) event.preventDefault(); });
map.addEventListener('dblclick', (event) => look(() => camera.zoom(2, ...placeOf(event))));
map.addEventListener('wheel', (event) => {
  event.preventDefault();
  const lines = event.deltaMode === 1 ? 30 : 1;
  look(() => camera.zoom(Math.exp(-event.deltaY * lines * (event.ctrlKey ? 0.01 : 0.0016)), ...placeOf(event)));
}, { passive: false });

function hover(found, place) {
  const tip = byId('hover');
  tip.hidden = !found;
  if (found) {
    tip.textContent = nameOf(scene, found);
    tip.style.left = `${Math.min(place[0] + 14, camera.width - tip.offsetWidth - 6)}px`;
    tip.style.top = `${Math.max(place[1] - 30, 6)}px`;
  }
  if (found || overlay.hover) {
    overlay.hover = found;
    request();
  }
}

// --- keys ----------------------------------------------------------------------------------------------------------

const STEP = 70; // pixels

map.addEventListener('keydown', (event) => {
  if (event.ctrlKey || event.metaKey || event.altKey) return;
  const arrow = { ArrowLeft: [1, 0], ArrowRight: [-1, 0], ArrowUp: [0, 1], ArrowDown: [0, -1] }[event.key];
  const turn = space && arrow && !event.shiftKey;
  const actions = {
    '+': () => look(() => camera.zoom(1.4)), '=': () => look(() => camera.zoom(1.4)), '-': () => look(() => camera.zoom(1 / 1.4)),
    0: () => look(() => camera.fit(projection.box())), ' ': () => timeline.toggle(), ',': () => timeline.step(-1, layers.born),
    '.': () => timeline.step(1, layers.born), Home: () => timeline.set(0), End: () => timeline.set(scene.end),
    n: () => stepClosure(1), p: () => stepClosure(-1), f: fullScreen, Escape: () => select(null, false),
    Enter: () => select(pick(scene, layers, camera, camera.width / 2, camera.height / 2, timeline.until, 60), false),
  };
  const action = arrow ? () => look(() => (turn ? camera.turn(-arrow[0] * 0.12, arrow[1] * 0.12)
    : camera.pan(arrow[0] * STEP, arrow[1] * STEP))) : actions[event.key];
  if (!action) return;
  event.preventDefault();
  action();
});

// --- buttons, layers, theme ----------------------------------------------------------------------------------------

function fullScreen() {
  if (document.fullscreenElement) document.exitFullscreen();
  else byId('workbench').requestFullscreen?.();
}

byId('zoom-in').addEventListener('click', () => look(() => camera.zoom(1.6)));
byId('zoom-out').addEventListener('click', () => look(() => camera.zoom(1 / 1.6)));
byId('fit').addEventListener('click', () => look(() => camera.fit(projection.box())));
byId('full').addEventListener('click', fullScreen);
byId('full').hidden = !document.fullscreenEnabled;

function sample(layer) {
  const drawings = {
    line: '<path d="M1 7h24" fill="none" stroke="currentColor" stroke-width="2.5"/>',
    dash: '<path d="M1 7h24" fill="none" stroke="currentColor" stroke-width="2.5" stroke-dasharray="5 3"/>',
    dots: '<path d="M1 7h24" fill="none" stroke="currentColor" stroke-width="2.5" stroke-dasharray="2 3"/>',
    'dash-dot': '<path d="M1 7h24" fill="none" stroke="currentColor" stroke-width="2.5" stroke-dasharray="7 3 2 3"/>',
    dot: '<circle cx="13" cy="7" r="3" fill="currentColor"/>', triangle: '<path d="M13 1l6 11H7z" fill="currentColor"/>',
    ring: '<ellipse cx="13" cy="7" rx="10" ry="5" fill="none" stroke="currentColor" stroke-width="1.6"/>',
    box: '<path d="M3 12V2h20v10" fill="none" stroke="currentColor" stroke-width="2.5"/>',
  };
  const svg = make('span', { style: `color:${layer.colour()};display:inline-flex` });
  svg.innerHTML = `<svg viewBox="0 0 26 14" aria-hidden="true">${drawings[layer.mark]}</svg>`;
  return svg;
}

function listLayers() {
  byId('layer-list').replaceChildren(...layers.list.map((layer) => {
    const box = make('input', { type: 'checkbox', 'data-layer': layer.id });
    box.checked = layer.on;
    box.addEventListener('change', () => {
      layer.on = box.checked;
      ground.invalidate();
      request();
    });
    return make('label', {}, box, sample(layer), layer.label,
      make('span', { class: 'count' }, layer.count ? layer.count.toLocaleString('en') : ''));
  }).reverse());
  if (layers.get('ellipses')) {
    const choice = make('select', { 'aria-label': 'Size of the ellipses' }, ...[1, 5, 25, 100].map((k) => make('option', { value: k }, k === 1 ? 'true size' : `${k} times as large`)));
    choice.value = String(layers.magnify);
    choice.addEventListener('change', () => {
      layers.magnify = Number(choice.value);
      ground.invalidate();
      request();
    });
    byId('layer-list').append(make('label', {}, 'Ellipses', choice));
  }
}

function restyle(theme) {
  setTheme(theme);
  grid?.colour();
  ground.invalidate();
  listLayers();
  inspector.show(selection);
  request();
  drawCharts();
}

byId('theme').addEventListener('click', () => restyle(document.documentElement.dataset.theme === 'dark' ? 'light' : 'dark'));
systemDark.addEventListener('change', (event) => restyle(event.matches ? 'dark' : 'light'));

document.addEventListener('click', (event) => {
  const button = event.target.closest?.('[data-focus]');
  if (!button) return;
  const [kind, row, last] = button.dataset.focus.split(' ');
  select({ kind, row: Number(row), last: Number(last) }, true);
});

if (space) {
  document.body.classList.add('space');
  map.setAttribute('aria-label', map.getAttribute('aria-label').replace('Drag or use the arrow keys to move it',
    'Drag or use the arrow keys to turn it, with shift to move it'));
}
byId('layers').open = window.innerWidth > 1000;
byId('closure-keys').hidden = !scene.closures.length;
listLayers();
inspector.show(null);
new ResizeObserver(resize).observe(stage);
resize();
