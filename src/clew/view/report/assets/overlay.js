// What changes from frame to frame, above the ground: the robots at the moment, their scans, and the selection.

/** Row of the last pose of a path or robot at a moment, or -1. */
const rowAt = (times, moment) => after(times, moment) - 1;

class Overlay {
  constructor(canvas, scene, layers) {
    this.canvas = canvas;
    this.scene = scene;
    this.layers = layers;
    this.hover = null;
    this.tracks = scene.robots.map((_, robot) => this.trackOf(robot));
  }

  /** Where a robot is at each moment: its dense path, or else its poses in the order of time. */
  trackOf(robot) {
    const { scene } = this;
    const path = scene.paths.find((p) => p.kind === 'trajectory' && p.robot === robot);
    const poses = this.layers.poses.filter((i) => scene.robot[i] === robot);
    return { path, poses, times: Float32Array.from(poses, (i) => scene.time[i]) };
  }

  draw(camera, moment, selection) {
    const ratio = window.devicePixelRatio || 1, context = this.canvas.getContext('2d');
    context.setTransform(ratio, 0, 0, ratio, 0, 0);
    context.clearRect(0, 0, camera.width, camera.height);
    context.lineJoin = context.lineCap = 'round';
    if (selection) this.selected(context, camera, selection);
    if (this.hover) this.ring(context, camera, this.hover, 1.5);
    this.tracks.forEach((track, robot) => this.robot(context, camera, track, robot, moment, Boolean(selection)));
  }

  /** Points of a pose's scan at a pose; `T` is x, y, heading. */
  scan(context, camera, row, T, colour) {
    const points = this.scene.scans.of(row), [c, s] = [Math.cos(T[2]), Math.sin(T[2])];
    const size = camera.scale > 25 ? 1.7 : 1.2;
    context.fillStyle = colour;
    context.beginPath();
    for (let k = 0; k < points.length; k += 2) {
      const x = camera.toScreenX(T[0] + c * points[k] - s * points[k + 1]);
      const y = camera.toScreenY(T[1] + s * points[k] + c * points[k + 1]);
      context.rect(x - size, y - size, 2 * size, 2 * size);
    }
    context.fill();
  }

  poseOf(row) {
    return [this.scene.vertex[0][row], this.scene.vertex[1][row], this.scene.heading[row]];
  }

  robot(context, camera, track, robot, moment, quiet) {
    const { scene } = this, { path, poses, times } = track;
    const at = Math.max(0, Math.min(rowAt(times, moment), poses.length - 1));
    if (!poses.length) return;
    if (scene.scans && moment < scene.end && !quiet) this.scan(context, camera, poses[at], this.poseOf(poses[at]), colours.scan);
    let x, y, heading;
    if (path) {
      const i = Math.max(0, rowAt(path.time, moment));
      const j = Math.min(i + 1, path.x.length - 1), gap = path.time[j] - path.time[i];
      const share = gap > 0 ? Math.min(1, Math.max(0, (Math.min(moment, scene.end) - path.time[i]) / gap)) : 0;
      [x, y] = [path.x[i] + share * (path.x[j] - path.x[i]), path.y[i] + share * (path.y[j] - path.y[i])];
      heading = path.heading[i];
    } else {
      const { u, v } = this.layers.projection;
      [x, y, heading] = [u[poses[at]], v[poses[at]], scene.heading[poses[at]]];
    }
    const sx = camera.toScreenX(x), sy = camera.toScreenY(y);
    context.fillStyle = colourOf(robot);
    context.strokeStyle = colours.halo;
    context.lineWidth = 2;
    context.beginPath();
    if (scene.dim === 2) {
      context.save();
      context.translate(sx, sy);
      context.rotate(-heading);
      context.moveTo(11, 0);
      context.lineTo(-7, 7);
      context.lineTo(-4, 0);
      context.lineTo(-7, -7);
      context.closePath();
      context.restore();
    } else context.arc(sx, sy, 6, 0, 2 * Math.PI);
    context.stroke();
    context.fill();
  }

  ring(context, camera, selection, width) {
    const { u, v } = this.layers.projection, vertices = verticesOf(this.scene, selection);
    context.strokeStyle = colours.select;
    context.lineWidth = width;
    if (vertices.length > 1) {
      context.beginPath();
      vertices.forEach((i, k) => context[k ? 'lineTo' : 'moveTo'](camera.toScreenX(u[i]), camera.toScreenY(v[i])));
      context.stroke();
    }
    for (const i of vertices.length > 2 ? [vertices[0], vertices[vertices.length - 1]] : vertices) {
      context.beginPath();
      context.arc(camera.toScreenX(u[i]), camera.toScreenY(v[i]), 8, 0, 2 * Math.PI);
      context.stroke();
    }
  }

  selected(context, camera, selection) {
    const { scene } = this;
    if (scene.scans && (selection.kind === 'pose' || selection.kind === 'closure')) { // a veil, so that the scans stand out
      context.fillStyle = `rgba(${colours.stage.join(', ')}, 0.55)`;
      context.fillRect(0, 0, camera.width, camera.height);
    }
    if (scene.scans && selection.kind === 'pose') {
      this.scan(context, camera, selection.row, this.poseOf(selection.row), colours.scan);
    }
    if (scene.scans && selection.kind === 'closure') {
      const { source, target } = scene.closures[selection.row];
      this.scan(context, camera, target, this.poseOf(target), colours.scan);
      this.scan(context, camera, source, this.poseOf(source), colours.other);
    }
    if (scene.covariance && selection.kind === 'pose') {
      const { u, v } = this.layers.projection, i = selection.row;
      const { major, minor, angle } = ellipseOf(scene.covariance.subarray(6 * i, 6 * i + 6), camera);
      const k = camera.scale * this.layers.magnify;
      context.strokeStyle = colours.ellipse;
      context.lineWidth = 2;
      context.beginPath();
      context.ellipse(camera.toScreenX(u[i]), camera.toScreenY(v[i]), major * k, minor * k, -angle, 0, 2 * Math.PI);
      context.stroke();
    }
    this.ring(context, camera, selection, selection.kind === 'span' ? 5 : 2.5);
  }
}
