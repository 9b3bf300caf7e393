// What lies under the pointer. A selection is {kind, row, last}: pose, landmark, closure, edge, or a span of poses.

function distanceToSegment(px, py, ax, ay, bx, by) {
  const dx = bx - ax, dy = by - ay, squared = dx * dx + dy * dy;
  const t = squared ? Math.min(1, Math.max(0, ((px - ax) * dx + (py - ay) * dy) / squared)) : 0;
  return Math.hypot(px - ax - t * dx, py - ay - t * dy);
}

/** Nearest visible thing within reach of a point of the screen, or null. */
function pick(scene, layers, camera, sx, sy, until, reach = 11) {
  const { u, v } = layers.projection;
  let best = null, least = reach;
  const offer = (kind, row, distance) => {
    if (distance < least) [best, least] = [{ kind, row, last: -1 }, distance];
  };
  if (scene.marks && layers.shows('landmarks')) {
    for (let i = scene.count; i < scene.count + scene.marks; i++) {
      offer('landmark', i - scene.count, Math.hypot(camera.toScreenX(u[i]) - sx, camera.toScreenY(v[i]) - sy) - 2);
    }
  }
  if (scene.closures.length) {
    const [mx, my] = layers.middlesOf();
    scene.closures.forEach((closure, k) => {
      const shown = layers.shows(closureLayer(closure));
      if (!shown || scene.time[closure.source] > until) return;
      offer('closure', k, Math.hypot(camera.toScreenX(mx[k]) - sx, camera.toScreenY(my[k]) - sy) - 1);
      const a = closure.target, b = closure.source;
      offer('closure', k, 3 + distanceToSegment(sx, sy, camera.toScreenX(u[a]), camera.toScreenY(v[a]),
        camera.toScreenX(u[b]), camera.toScreenY(v[b])));
    });
  }
  for (let i = 0; i < scene.count; i++) {
    if (scene.time[i] <= until) {
      offer('pose', i, Math.hypot(camera.toScreenX(u[i]) - sx, camera.toScreenY(v[i]) - sy));
    }
  }
  return best || pickEdge(scene, layers, camera, sx, sy, until);
}

function pickEdge(scene, layers, camera, sx, sy, until) {
  const { u, v } = layers.projection, { ends, role, weight, born } = scene.edges;
  let best = null, least = 6;
  for (let e = 0; e < role.length; e++) {
    const layer = weight[e] < 0.5 ? 'doubted' : ROLES[role[e]];
    if (born[e] > until || !(layers.shows(layer) || (layer === 'odometry' && layers.shows('odometry-edges')))) continue;
    const a = ends[2 * e], b = ends[2 * e + 1];
    const distance = distanceToSegment(sx, sy, camera.toScreenX(u[a]), camera.toScreenY(v[a]),
      camera.toScreenX(u[b]), camera.toScreenY(v[b]));
    if (distance < least) [best, least] = [{ kind: 'edge', row: e, last: -1 }, distance];
  }
  return best;
}

/** Vertices that a selection consists of. */
function verticesOf(scene, selection) {
  const { kind, row, last } = selection;
  if (kind === 'pose') return [row];
  if (kind === 'landmark') return [scene.count + row];
  if (kind === 'closure') return [scene.closures[row].target, scene.closures[row].source];
  if (kind === 'edge') return [scene.edges.ends[2 * row], scene.edges.ends[2 * row + 1]];
  return Array.from({ length: last - row + 1 }, (_, k) => row + k);
}

/** Name of a selection in a few words. */
function nameOf(scene, selection) {
  const { kind, row, last } = selection;
  if (kind === 'pose') return `Pose ${scene.name[row]}`;
  if (kind === 'landmark') return `Landmark ${scene.mark.name[row]}`;
  if (kind === 'closure') {
    const closure = scene.closures[row];
    return `Closure ${scene.name[closure.source]} → ${scene.name[closure.target]}`;
  }
  if (kind === 'edge') {
    const name = (i) => (i < scene.count ? `${scene.name[i]}` : `landmark ${scene.mark.name[i - scene.count]}`);
    return `${ROLES[scene.edges.role[row]]} edge ${name(scene.edges.ends[2 * row])} → ${name(scene.edges.ends[2 * row + 1])}`;
  }
  return `Poses ${scene.name[row]} to ${scene.name[last]}`;
}
