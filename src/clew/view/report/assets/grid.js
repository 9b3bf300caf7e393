// The occupancy grid: one picture in the colours of the theme, and smaller ones of it to draw from when far away.

class Grid {
  /** @param {object} raw @param {() => void} ready called when the picture is there */
  constructor(raw, ready) {
    this.raw = raw;
    this.levels = []; // canvases, each half as large as the one before
    this.image = new Image();
    this.image.onload = () => {
      this.colour();
      ready();
    };
    this.image.src = raw.image;
  }

  /** Paint it in the present colours. */
  colour() {
    if (!this.image.complete || !this.image.naturalWidth) return;
    const { rows, cols, levels } = this.raw;
    const canvas = document.createElement('canvas');
    canvas.width = cols;
    canvas.height = rows;
    const context = canvas.getContext('2d', { willReadFrequently: true });
    context.drawImage(this.image, 0, 0);
    const pixels = context.getImageData(0, 0, cols, rows);
    const table = new Uint32Array(256);
    for (let level = 1; level < 256; level++) table[level] = shade((level - 1) / levels);
    const cells = new Uint32Array(pixels.data.buffer);
    for (let i = 0; i < cells.length; i++) cells[i] = table[cells[i] & 255];
    context.putImageData(pixels, 0, 0);
    // A copy that was never read from may live where drawing is quick.
    this.levels = [halved(canvas, cols, rows)];
    for (let w = cols >> 1, h = rows >> 1; w > 64 && h > 64; w >>= 1, h >>= 1) {
      this.levels.push(halved(this.levels[this.levels.length - 1], w, h));
    }
  }

  draw(context, camera) {
    if (!this.levels.length) return;
    const { origin, rows, cols, resolution } = this.raw;
    const pixels = resolution * camera.scale * window.devicePixelRatio;
    let level = 0;
    while (level + 1 < this.levels.length && pixels * 2 ** level < 0.55) level++;
    context.imageSmoothingEnabled = pixels < 2;
    context.drawImage(this.levels[level], camera.toScreenX(origin[0]), camera.toScreenY(origin[1] + rows * resolution),
      cols * resolution * camera.scale, rows * resolution * camera.scale);
  }
}

function halved(canvas, width, height) {
  const small = document.createElement('canvas');
  small.width = width;
  small.height = height;
  small.getContext('2d').drawImage(canvas, 0, 0, width, height);
  return small;
}

/** Colour of a probability as the number that a little-endian machine stores as red, green, blue, opaque. */
function shade(probability) {
  const mix = (a, b, share) => a.map((value, c) => Math.round(value + (b[c] - value) * share));
  const half = mix(colours.stage, colours.occupied, 0.5);
  const [r, g, b] = probability <= 0.5
    ? mix(colours.free, colours.stage, Math.max(0, (probability - 0.25) / 0.25))
    : mix(half, colours.occupied, Math.min(1, (probability - 0.5) / 0.2));
  return ((255 << 24) | (b << 16) | (g << 8) | r) >>> 0;
}
