// The moment that is shown, and the replay.

class Timeline {
  /** @param {(moment: number) => void} changed */
  constructor(scene, changed) {
    this.scene = scene;
    this.changed = changed;
    this.moment = scene.end;
    this.playing = false;
    this.slider = byId('time');
    this.button = byId('play');
    this.speed = byId('speed');
    this.slider.max = '10000';
    this.slider.value = '10000';
    for (const [text, seconds] of [['in 15 s', 15], ['in 30 s', 30], ['in 60 s', 60], ['real time', 0]]) {
      if (seconds || scene.timed) this.speed.append(make('option', { value: seconds }, text));
    }
    this.speed.value = '30';
    this.slider.addEventListener('input', () => {
      this.pause();
      this.set((this.slider.valueAsNumber / 10000) * scene.end);
    });
    this.button.addEventListener('click', () => this.toggle());
    byId('timeline').hidden = !(scene.end > 0);
    this.write();
  }

  /** Where layers end: everything is shown at the end. */
  get until() { return this.moment >= this.scene.end ? Infinity : this.moment; }

  set(moment) {
    this.moment = Math.min(Math.max(moment, 0), this.scene.end);
    this.slider.value = String(Math.round((this.moment / (this.scene.end || 1)) * 10000));
    this.write();
    this.changed(this.moment);
  }

  write() {
    const text = this.scene.timed ? `${this.moment.toFixed(1)} / ${this.scene.end.toFixed(1)} s`
      : `${Math.round(this.moment).toLocaleString('en')} / ${this.scene.end.toLocaleString('en')}`;
    byId('clock').textContent = text;
    this.slider.setAttribute('aria-valuetext', when(this.scene, this.moment));
  }

  /** To the next or previous pose. */
  step(by, times) {
    this.pause();
    const row = by > 0 ? after(times, this.moment + 1e-4) : after(times, this.moment - 1e-3 * (1 + this.moment * 1e-4)) - 1;
    this.set(times[Math.min(Math.max(row, 0), times.length - 1)]);
  }

  toggle() {
    if (this.playing) this.pause(); else this.play();
  }

  play() {
    if (this.moment >= this.scene.end) this.set(0);
    this.playing = true;
    this.button.classList.add('playing');
    this.button.setAttribute('aria-label', 'Pause');
    let before = performance.now();
    const frame = (now) => {
      if (!this.playing) return;
      const whole = Number(this.speed.value) || this.scene.end;
      const moment = this.moment + (Math.min(now - before, 200) / 1000) * (this.scene.end / whole);
      before = now;
      this.set(moment);
      if (moment >= this.scene.end) this.pause(); else requestAnimationFrame(frame);
    };
    requestAnimationFrame(frame);
  }

  pause() {
    this.playing = false;
    this.button.classList.remove('playing');
    this.button.setAttribute('aria-label', 'Play');
  }
}
