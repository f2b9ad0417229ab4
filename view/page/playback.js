// SPDX-License-Identifier: Apache-2.0
// The player of a recording: play, stand still, go elsewhere, faster and slower. What it shows is
// what the player says, not what was asked for.

const kSpeeds = [0.1, 0.25, 0.5, 1, 2, 4, 8];
const kSteps_s = {ArrowLeft: -1, ArrowRight: 1, ',': -0.01, '.': 0.01};
const kAskAgain_ms = 1000;  // a place that is not reached by then may be asked for again

const by_id = (id) => document.getElementById(id);

function clock(time_s) {
  const minutes = Math.floor(time_s / 60);
  return `${minutes}:${(time_s - 60 * minutes).toFixed(2).padStart(5, '0')}`;
}

export class Playback {
  /**
   * @param connection what commands go to.
   * @param on_anew called when what comes next is not what follows: rows and samples go.
   */
  constructor(connection, on_anew) {
    this.connection = connection;
    this.on_anew = on_anew;
    this.recording = null;  // of the hello
    this.now = {state: 'paused', time_s: 0, speed: 1};
    this.wanted_s = null;   // that the person asks for and the player has not reached
    this.asked_s = null;    // of these the one that was sent
    this.asked_ms = -Infinity;
    this.under_way = false; // the player said so since
    this.allowed = false;
    this.bar = by_id('playback');
    this.button = by_id('play');
    this.slider = by_id('play-time');
    this.speed = by_id('play-speed');
    this.speed.replaceChildren(...kSpeeds.map((speed) => new Option(`${speed} ×`, speed)));
    this.speed.value = 1;
    this.button.addEventListener('click', () => this.toggle());
    this.slider.addEventListener('input', () => this.go_to(Number(this.slider.value)));
    this.slider.addEventListener('keydown', (event) => this.step(event));
    this.speed.addEventListener('change', () => this.send_play(this.playing));
  }

  /** Is a recording shown, not a run? */
  get shown() {
    return this.recording !== null;
  }

  get playing() {
    return this.now.state === 'playing';
  }

  /** The player is on its way: what comes is not yet what is to be shown. */
  get seeking() {
    return this.shown && this.now.state === 'seeking';
  }

  /** A recording begins, or a run. */
  set_run(hello) {
    this.recording = hello.recording || null;
    this.bar.hidden = !this.shown;
    this.wanted_s = this.asked_s = null;
    this.under_way = false;
    this.now = {state: 'paused', time_s: 0, speed: 1};
    if (this.shown) {
      const {duration_s, file, complete, surface, note} = this.recording;
      this.slider.max = duration_s;
      by_id('play-length').textContent = clock(duration_s);
      by_id('play-file').textContent = file;
      by_id('play-file').title = [this.recording.started_utc && `of ${this.recording.started_utc}`,
                                  !complete && 'not closed by its writer',
                                  !surface && 'without a surface', note].filter(Boolean).join('; ');
      this.show();
    }
  }

  set_allowed(allowed) {
    this.allowed = allowed;
    [this.button, this.slider, this.speed].forEach((one) => { one.disabled = !allowed; });
    this.button.title = allowed ? 'Play, or stand still (space)' : 'another page has the control';
  }

  /** A message of the player. */
  take(message) {
    if (message.anew) {
      this.on_anew();
    }
    this.now = message;
    if (message.state === 'seeking') {
      this.under_way = true;
    } else if (this.under_way) {
      this.wanted_s = this.asked_s === this.wanted_s ? null : this.wanted_s;
      this.asked_s = null;
      this.under_way = false;
      this.ask();
    }
    this.show();
  }

  toggle() {
    if (this.allowed) {
      this.send_play(!this.playing);
    }
  }

  send_play(value) {
    this.connection.send('play', {value, speed: Number(this.speed.value)});
  }

  step(event) {
    const step_s = kSteps_s[event.key];
    if (step_s !== undefined && !event.ctrlKey && !event.altKey && !event.metaKey) {
      event.preventDefault();
      this.go_to(Number(this.slider.value) + step_s);
    }
  }

  /** Goes to a time; of many while the player is on its way, only the newest counts. */
  go_to(time_s) {
    if (this.shown && this.allowed) {
      this.wanted_s = Math.min(this.recording.duration_s, Math.max(0, time_s));
      this.ask();
      this.show();
    }
  }

  ask() {
    if (this.wanted_s === null || this.wanted_s === this.asked_s ||
        (this.asked_s !== null && performance.now() - this.asked_ms < kAskAgain_ms)) {
      return;
    }
    if (this.connection.send('seek', {time_s: this.wanted_s}) !== null) {
      this.asked_s = this.wanted_s;
      this.asked_ms = performance.now();
    }
  }

  show() {
    const {state, time_s, speed} = this.now;
    const shown_s = this.wanted_s === null ? time_s : this.wanted_s;
    this.slider.value = shown_s;
    this.slider.setAttribute('aria-valuetext', `${shown_s.toFixed(2)} s`);
    by_id('play-now').textContent = clock(shown_s);
    this.bar.dataset.playing = state;
    this.button.dataset.playing = String(this.playing);
    const word = this.playing ? 'Pause' : 'Play';
    if (this.button.getAttribute('aria-label') !== word) {
      this.button.setAttribute('aria-label', word);
    }
    if (document.activeElement !== this.speed && Number(this.speed.value) !== speed &&
        kSpeeds.includes(speed)) {
      this.speed.value = speed;
    }
  }
}
