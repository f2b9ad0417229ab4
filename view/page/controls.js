// SPDX-License-Identifier: Apache-2.0
// Stop, pause, take control, keys.

const kRepeatStop_ms = 1000;

/**
 * Stop. Any page may send it, in any state. It is sent again each second until the servo
 * acknowledges it, and as soon as a lost connection is back.
 */
export class Stop {
  constructor(connection, button, word, status) {
    this.connection = connection;
    this.button = button;
    this.word = word;
    this.status = status;
    this.state = 'idle';
    this.ids = new Set();
    button.addEventListener('click', () => this.press());
    setInterval(() => this.repeat(), kRepeatStop_ms);
  }

  get acknowledged() {
    return this.state === 'acknowledged';
  }

  press() {
    if (this.state !== 'acknowledged') {
      this.state = 'sent';
    }
    this.send();
  }

  send() {
    const id = this.connection.send('stop');
    if (id !== null) {
      this.ids.add(id);
    }
    this.show(id === null
        ? 'No connection: stop is not sent yet. Use the switch of the device.'
        : this.acknowledged ? this.status.textContent : 'stopping…');
  }

  repeat() {
    if (this.state === 'sent') {
      this.send();
    }
  }

  /** An acknowledged message of the live view. */
  on_acknowledged(message) {
    if (message.what !== 'stop' || this.state === 'idle') {
      return;
    }
    if (message.done) {
      this.state = 'acknowledged';
      this.show(`stopped, acknowledged by the servo${message.text ? `: ${message.text}` : ''}`);
    } else {
      this.show(`not stopped: ${message.text || 'the servo refused'}`);
    }
  }

  on_end() {
    if (this.state === 'sent') {
      this.state = 'ended';
      this.show('the run has ended');
    }
  }

  /** Another run begins: it is not stopped, unless this page still waits for its answer. */
  on_run() {
    if (this.state === 'acknowledged' || this.state === 'ended') {
      this.state = 'idle';
      this.show('');
    }
    this.ids.clear();
    this.repeat();
  }

  show(text) {
    this.status.textContent = text;
    this.status.hidden = text === '';
    this.status.dataset.stop = this.state;
    this.button.dataset.stop = this.state;
    this.word.textContent = {idle: 'Stop', sent: 'Stopping…'}[this.state] || 'Stopped';
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
 * Keys. Space is stop wherever the focus is; enter presses the button that has it.
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
    const typing = event.target instanceof HTMLSelectElement;
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
