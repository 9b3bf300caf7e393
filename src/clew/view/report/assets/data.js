// The data of the page: arrays as base64 of little-endian numbers.

/** @typedef {{type: string, data: string}} Packed */

/** @param {Packed} packed */
function unpack(packed) {
  const text = atob(packed.data);
  const bytes = new Uint8Array(text.length);
  for (let i = 0; i < text.length; i++) bytes[i] = text.charCodeAt(i);
  const kinds = { f4: Float32Array, i4: Int32Array, i2: Int16Array, u1: Uint8Array };
  return new kinds[packed.type](bytes.buffer);
}

/** @param {string} id */
const byId = (id) => /** @type {HTMLElement} */ (document.getElementById(id));

/** Two or three coordinates of rows, as arrays of their own. */
function columns(flat, width) {
  const count = flat.length / width;
  return Array.from({ length: width }, (_, c) => {
    const column = new Float32Array(count);
    for (let i = 0; i < count; i++) column[i] = flat[i * width + c];
    return column;
  });
}

/** First index of a sorted array whose value is greater than x. */
function after(sorted, x) {
  let low = 0, high = sorted.length;
  while (low < high) {
    const middle = (low + high) >> 1;
    if (sorted[middle] <= x) low = middle + 1; else high = middle;
  }
  return low;
}

/** Everything that the map draws; among the vertices poses come first, then landmarks, then poses that were summarised. */
function readScene(raw) {
  const dim = raw.dim, poses = raw.poses, marks = raw.landmarks, gone = raw.summarised;
  const pose = columns(unpack(poses.position), dim), mark = columns(unpack(marks.position), dim);
  const count = pose[0].length, marksCount = mark[0].length;
  const lost = columns(unpack(gone.position), dim), first = count + marksCount;
  const joined = (own, others, between) => {
    const all = new Float32Array(first + lost[0].length);
    all.set(own);
    if (between) all.set(between, count);
    all.set(others, first);
    return all;
  };
  const vertex = pose.map((axis, c) => joined(axis, lost[c], mark[c]));
  const namesOf = (names) => (Array.isArray(names) ? names : Array.from(unpack(names), String));
  const vertexOf = (row) => (row < count ? row : row + marksCount);
  const time = joined(unpack(poses.time), unpack(gone.time));
  const robot = unpack(poses.robot);
  const scene = {
    dim, timed: raw.timed, begin: raw.begin, centre: raw.centre, robots: raw.robots,
    count, marks: marksCount, vertex, time, robot,
    heading: joined(unpack(poses.heading), unpack(gone.heading)),
    name: namesOf(poses.name).concat(Array(marksCount).fill(''), namesOf(gone.name)),
    covariance: poses.covariance && unpack(poses.covariance),
    mark: {
      name: marks.name, sightings: unpack(marks.sightings), covariance: marks.covariance && unpack(marks.covariance),
    },
    paths: raw.paths.map((path) => {
      const [x, y, heading] = columns(unpack(path.pose), 3);
      return { name: path.name, kind: path.kind, robot: path.robot, time: unpack(path.time), x, y, heading };
    }),
    closures: raw.closures.map((closure) => ({ ...closure, source: vertexOf(closure.source), target: vertexOf(closure.target) })),
    edges: readEdges(raw.edges, time, count),
    scans: readScans(raw.scans),
    grid: raw.grid,
    end: 0,
  };
  for (const times of [time, ...scene.paths.map((path) => path.time)]) {
    for (let i = 0; i < times.length; i++) if (times[i] > scene.end) scene.end = times[i];
  }
  return scene;
}

/** Edges with the moment from which both their ends are there. */
function readEdges(raw, time, count) {
  const ends = unpack(raw.ends), role = unpack(raw.role);
  const born = new Float32Array(role.length);
  for (let e = 0; e < role.length; e++) {
    const a = ends[2 * e], b = ends[2 * e + 1];
    born[e] = Math.max(a < count ? time[a] : 0, b < count ? time[b] : 0);
  }
  return { ends, role, born, squared: unpack(raw.squared), weight: unpack(raw.weight) };
}

/** Scans are many: they are unpacked when the first of them is asked for. */
function readScans(raw) {
  if (!raw) return null;
  const first = unpack(raw.first);
  let points = null;
  return {
    /** Whether there is a scan: that of a pose which was summarised is gone. */
    has: (row) => row + 1 < first.length,
    /** Points of a pose in the robot's frame: x, y, x, y, ... metres. */
    of(row) {
      if (!this.has(row)) return new Float32Array(0);
      points = points || unpack(raw.points);
      const out = new Float32Array(2 * (first[row + 1] - first[row]));
      for (let i = 0, k = 2 * first[row]; i < out.length; i++, k++) out[i] = points[k] * raw.step;
      return out;
    },
  };
}
