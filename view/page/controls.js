// SPDX-License-Identifier: Apache-2.0
// Stop, pause, take control, keys.

const kRepeatStop_ms = 1000;
const kUrgent_ms = 150;
const kEnded = 'the run has ended';

/**
 * Stop. Any page may send it, in any state. While a run is there it is sent again each second until
 * the servo acknowledges it, and as soon as a lost connection is back.
 */
export class Stop {
  /** @param is_live() tells whether the page shows a run. */
  constructor(connection, button, word, status, is_live) {
    this.connection = connection;
    this.button = button;
    this.word = word;
    this.status = status;
    this.is_live = is_live;
    this.state = 'idle';  // then sent, acknowledged or ended
    this.refusal = '';
    this.run_is_over = false;
    this.instead = null;
    this.pressed_ms = -Infinity;
    button.addEventListener('click', () => this.press());
    setInterval(() => this.repeat(), kRepeatStop_ms);
  }

  get acknowledged() {
    return this.state === 'acknowledged';
  }

  /** Nothing may hold up the acknowledgement now: pictures, drawn by software, and the banner, which
   *  changes the size of everything below it, wait. */
  is_urgent(now_ms) {
    return this.state === 'sent' && now_ms - this.pressed_ms < kUrgent_ms;
  }

  /**
   * @param why there is nothing to stop; empty: there is. @param instead what the key does then.
   */
  set_off(why, instead) {
    this.instead = why ? instead : null;
    this.button.disabled = why !== '';
    this.button.title = why;
  }

  press() {
    if (this.instead) {
      this.instead();
      return;
    }
    this.refusal = '';
    this.pressed_ms = performance.now();
    if (!this.acknowledged) {
      this.state = this.run_is_over ? 'ended' : 'sent';
    }
    this.send();
  }

  send() {
    const sent = this.connection.send('stop') !== null;
    if (this.state === 'ended') {
      this.show(kEnded);
    } else if (!this.acknowledged && !sent) {
      this.show('No connection: stop is not sent yet. Use the switch of the device.');
    } else if (!this.acknowledged && this.refusal === '') {
      this.show('stopping…', this.is_urgent(performance.now()));
      setTimeout(() => { this.status.hidden = this.status.textContent === ''; }, kUrgent_ms);
    }
  }

  repeat() {
    if (this.state === 'sent') {
      this.send();
    }
  }

  /** An acknowledged message of the live view. */
  on_acknowledged(message) {
    if (message.what !== 'stop' || this.state !== 'sent') {
      return;
    }
    if (message.done) {
      this.state = 'acknowledged';
      this.show(`stopped, acknowledged by the servo${message.text ? `: ${message.text}` : ''}`);
      return;
    }
    this.refusal = message.text || 'the servo refused';
    if (!this.is_live()) {
      this.state = 'idle';  // there is nothing to stop, and the next run is not meant
    }
    this.show(`not stopped: ${this.refusal}`);
  }

  on_end() {
    this.run_is_over = true;
    if (this.state === 'sent') {
      this.state = 'ended';
      this.show(this.refusal ? `${kEnded}, but stop was not confirmed: ${this.refusal}` : kEnded);
    }
  }

  /** Another run begins: it is not stopped, unless this page still waits for its answer. */
  on_run() {
    this.run_is_over = false;
    this.refusal = '';
    if (this.state !== 'sent') {
      this.state = 'idle';
      this.show('');
    }
    this.repeat();
  }

  show(text, banner_waits = false) {
    this.status.textContent = text;
    this.status.hidden = text === '' || banner_waits;
    this.status.dataset.stop = this.state;
    this.button.dataset.stop = this.state;
    this.word.textContent = {idle: 'Stop', sent: 'Stopping…'}[this.state] || 'Stopped';
  }
}

/** Which method is rendered. What it shows is what the servo's rows say. */
export class Rendered {
  constructor(connection, list) {
    this.connection = connection;
    this.list = list;
    this.now = 0;
    this.offered = false;
    list.addEventListener('change', () => this.choose());
  }

  set_run(hello) {
    const methods = hello.methods || [];
    this.offered = (hello.controls || []).includes('method') && methods.length > 1;
    this.list.replaceChildren(...methods.map((name, i) => new Option(name, i)));
    this.now = 0;
  }

  set_allowed(allowed) {
    this.list.disabled = !(allowed && this.offered);
  }

  choose() {
    if (this.connection.send('method', {method: Number(this.list.value)}) === null) {
      this.list.value = this.now;
    }
  }

  /** The newest row's `rendered_method`. */
  set_now(method) {
    if (method !== this.now && method >= 0) {
      this.now = method;
      this.list.value = method;
    }
  }

  on_acknowledged(message) {
    if (message.what === 'method' && !message.done) {
      this.list.value = this.now;
    }
  }
}

/** Pause of the force. What it shows is what the servo's rows say, not what was asked for. */
export class Pause {
  constructor(connection, button) {
    this.connection = connection;
    this.button = button;
    this.paused = false;
    this.wanted = null;
    this.allowed = false;
    button.addEventListener('click', () => this.press());
  }

  press() {
    if (this.allowed) {
      this.wanted = !this.paused;
      if (this.connection.send('pause', {value: this.wanted}) === null) {
        this.wanted = null;
      }
      this.show();
    }
  }

  set_allowed(allowed, why) {
    this.allowed = allowed;
    this.button.disabled = !allowed;
    this.button.title = allowed ? 'Fade the force out, or in again (p)' : why;
    this.show();
  }

  /** The newest row's `paused`. */
  set_paused(paused) {
    if (paused !== this.paused || this.wanted === paused) {
      this.paused = paused;
      this.wanted = null;
      this.show();
    }
  }

  on_acknowledged(message) {
    if (message.what === 'pause' && !message.done) {
      this.wanted = null;
      this.show();
    }
  }

  show() {
    this.button.setAttribute('aria-pressed', String(this.paused));
    this.button.textContent = this.wanted === null ? (this.paused ? 'Resume force' : 'Pause force')
                                                   : (this.wanted ? 'Pausing…' : 'Resuming…');
  }
}

/**
 * Keys. Space is stop wherever the focus is; enter presses the button or the box that has it.
 * @param actions {p, f, o, '?', Escape}: functions.
 */
export function listen_to_keys(stop, actions) {
  const plain = (event) => !event.ctrlKey && !event.altKey && !event.metaKey;
  addEventListener('keydown', (event) => {
    if (event.key === ' ' && plain(event)) {
      event.preventDefault();
      event.stopPropagation();
      if (!event.repeat) {
        stop.press();
      }
      return;
    }
    if (event.key === 'Enter' && plain(event) && event.target.type === 'checkbox') {
      event.preventDefault();
      event.target.click();
      return;
    }
    const typing = event.target instanceof HTMLSelectElement ||
                   event.target instanceof HTMLInputElement;
    const key = event.key.length === 1 ? event.key.toLowerCase() : event.key;
    if (plain(event) && !typing && !event.repeat && Object.hasOwn(actions, key)) {
      event.preventDefault();
      actions[key]();
    }
  }, true);
  addEventListener('keyup', (event) => {
    if (event.key === ' ') {
      event.preventDefault();  // of a button that has the focus: it is not pressed
      event.stopPropagation();
    }
  }, true);
}
