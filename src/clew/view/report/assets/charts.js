// Curves over time below the map; a click goes to the moment.

class Chart {
  constructor(canvas, raw, scene, go) {
    this.canvas = canvas;
    this.time = unpack(raw.time);
    this.unit = raw.unit;
    this.curves = raw.curves.map((curve) => ({ name: curve.name, values: unpack(curve.values) }));
    this.scene = scene;
    this.most = 0;
    for (const { values } of this.curves) for (const value of values) if (value > this.most) this.most = value;
    this.most = this.most || 1;
    const moment = (event) => {
      const box = canvas.getBoundingClientRect();
      return ((event.clientX - box.left - this.left) / (box.width - this.left - 8)) * scene.end;
    };
    canvas.addEventListener('click', (event) => go(Math.min(Math.max(moment(event), 0), scene.end)));
    canvas.addEventListener('keydown', (event) => {
      const by = { ArrowLeft: -1, ArrowRight: 1 }[event.key];
      if (!by) return;
      event.preventDefault();
      go(Math.min(Math.max((this.now ?? scene.end) + by * scene.end / 200, 0), scene.end));
    });
    this.left = 52;
  }

  draw(now) {
    this.now = now;
    const { canvas, scene, left } = this, ratio = window.devicePixelRatio || 1;
    const width = canvas.clientWidth, height = canvas.clientHeight, bottom = height - 22;
    if (!width) return;
    if (canvas.width !== Math.round(width * ratio)) [canvas.width, canvas.height] = [Math.round(width * ratio), Math.round(height * ratio)];
    const context = canvas.getContext('2d'), style = getComputedStyle(canvas);
    context.setTransform(ratio, 0, 0, ratio, 0, 0);
    context.clearRect(0, 0, width, height);
    context.font = `12px ${style.fontFamily}`;
    context.lineWidth = 1;
    const toX = (t) => left + (t / (scene.end || 1)) * (width - left - 8);
    const step = niceStep(this.most / 3), top = Math.ceil(this.most / step) * step, toY = (v) => bottom - (v / top) * (bottom - 8);
    context.textAlign = 'right';
    context.textBaseline = 'middle';
    for (let v = 0; v <= top + 1e-9; v += step) {
      context.strokeStyle = colours.grid;
      context.beginPath();
      context.moveTo(left, Math.round(toY(v)) + 0.5);
      context.lineTo(width - 8, Math.round(toY(v)) + 0.5);
      context.stroke();
      context.fillStyle = style.color;
      context.globalAlpha = 0.75;
      context.fillText(v ? `${Number(v.toPrecision(3))} ${this.unit}` : '0', left - 7, toY(v));
      context.globalAlpha = 1;
    }
    context.textAlign = 'center';
    context.textBaseline = 'top';
    context.globalAlpha = 0.75;
    const along = niceStep(scene.end / Math.max(2, width / 130));
    for (let t = 0; t <= scene.end; t += along) {
      context.fillText(scene.timed ? `${Number(t.toPrecision(6))} s` : Number(t.toPrecision(6)).toLocaleString('en'), toX(t), bottom + 6);
    }
    context.globalAlpha = 1;
    this.curves.forEach(({ values }, c) => this.curve(context, values, toX, toY, colourOf(c)));
    if (now < scene.end) {
      context.strokeStyle = colours.loop;
      context.lineWidth = 2;
      context.beginPath();
      context.moveTo(toX(now), 0);
      context.lineTo(toX(now), bottom);
      context.stroke();
    }
  }

  /** The largest value of each column of pixels, so that peaks stay. */
  curve(context, values, toX, toY, colour) {
    context.strokeStyle = colour;
    context.lineWidth = 1.5;
    context.beginPath();
    let column = -1, most = 0;
    for (let i = 0; i < values.length; i++) {
      const x = Math.round(toX(this.time[i]));
      if (x !== column && column >= 0) {
        context.lineTo(column, toY(most));
        most = 0;
      }
      column = x;
      most = Math.max(most, values[i]);
    }
    context.lineTo(column, toY(most));
    context.stroke();
  }
}

/** The least of 1, 2 and 5 times a power of ten that is not below a value. */
function niceStep(least) {
  const power = 10 ** Math.floor(Math.log10(least || 1));
  return [1, 2, 5, 10].map((k) => k * power).find((step) => step >= least * 0.999);
}
