// SPDX-License-Identifier: Apache-2.0
// The tour: six steps, each with a text beside the picture. A step chooses method, hand, link, wall
// and cut through the controls that the person has, too.

const kStep_s = 30;
const kFewest_s = 0.2;
const kTick_ms = 100;
const kPlain = {hand: 'firm', simulator_rate_Hz: 30, delay_ms: 0, jitter_ms: 0, loss_percent: 0,
                wall_mm: null, cut: 'no'};

export const kSteps = [
  {
    key: 'streaming', title: 'Streaming shakes', method: 'hold',
    settings: kPlain,
    text: 'The simulator computes the force 30 times a second; the motors want one 500 times a ' +
        'second. Streaming gives them the newest force until the next one comes. Look at the ' +
        'force in the scope: a staircase. Each stair is a push that the object never gave, and ' +
        'the hand feels it as shaking.',
  },
  {
    key: 'grid', title: 'The paper’s grid', method: 'forcegrid',
    settings: kPlain,
    text: 'The force grid keeps the samples in space instead of time. At every cycle the force ' +
        'is read where the tool is, from the samples around it. Where the tool has been the ' +
        'force is smooth. Where it is new, the grid knows little.',
  },
  {
    key: 'auto', title: 'auto', method: 'auto',
    settings: kPlain,
    text: 'auto fits a smooth field to the samples and goes on beyond them. It runs several ' +
        'fields and renders the one whose last predictions were best: the coloured band under ' +
        'the force names it, and why. The steps are gone, also on new ways.',
  },
  {
    key: 'wall', title: 'A wall', method: 'auto',
    settings: {...kPlain, wall_mm: 12},
    text: 'A stiff wall stands above the object, and the tool runs into it. A smooth field ' +
        'cannot bend so sharply: the wall comes as a surprise. Then the candidate for walls ' +
        'speaks, which knows forces that push and never pull.',
  },
  {
    key: 'cut', title: 'A cut', method: 'auto',
    settings: {...kPlain, cut: 'yes'},
    text: 'The object has just been cut below the tool. Samples from before the cut are wrong ' +
        'now, and nothing says so but a new number of the contact, its epoch. The method ' +
        'forgets what it knew and learns the softer object within some samples.',
  },
  {
    key: 'delay', title: 'Delay', method: 'auto',
    settings: {...kPlain, delay_ms: 150, jitter_ms: 30},
    text: 'Now each force arrives 150 to 180 ms late. Streamed, it would push against where the ' +
        'hand was. In space an old sample is as good as a new one: it says what the force is at ' +
        'its place. Choose hold as the rendered method, above, and compare.',
  },
];

const by_id = (id) => document.getElementById(id);

export class Tour {
  /** @param on_resize() is told that the text has come or gone. */
  constructor(settings, connection, on_resize) {
    this.settings = settings;
    this.connection = connection;
    this.on_resize = on_resize;
    this.step = -1;  // none
    this.visited = [];  // keys of the steps that were set up
    this.offered = false;
    this.quit_by_person = false;
    this.stays = false;
    this.left_s = 0;
    this.hello = {};
    this.ready = false;  // what the step is about has been chosen
    this.allowed = false;
    this.last_ms = 0;
    const wanted_s = Number(new URLSearchParams(location.search).get('step_s'));
    this.step_s = wanted_s > 0 ? Math.max(kFewest_s, wanted_s) : kStep_s;
    by_id('tour-next').addEventListener('click', () => this.go(this.step + 1));
    by_id('tour-back').addEventListener('click', () => this.go(this.step - 1));
    by_id('tour-stay').addEventListener('click', () => this.stay(!this.stays));
    by_id('tour-quit').addEventListener('click', () => this.quit());
    setInterval(() => this.tick(performance.now()), kTick_ms);
  }

  get current() {
    return kSteps[this.step];
  }

  /** Another run begins: the tour's, or one with another scene on the way. */
  set_run(hello) {
    this.hello = hello;
    this.offered = hello.tour === true;
    this.ready = false;
    if (this.offered && this.step < 0 && !this.quit_by_person) {
      this.go(0);
    }
  }

  set_allowed(allowed) {
    this.allowed = allowed;
  }

  /** Now and then while the run is live: sets up the step. */
  on_live() {
    if (this.step >= 0 && !this.ready && this.allowed) {
      this.set_up();
    }
  }

  go(step) {
    if (step >= kSteps.length) {
      this.quit();
      return;
    }
    this.step = Math.max(0, step);
    this.ready = false;
    this.left_s = this.step_s;
    const {title, text, key} = this.current;
    by_id('tour').dataset.step = key;
    by_id('tour-place').textContent = `Step ${this.step + 1} of ${kSteps.length}`;
    by_id('tour-title').textContent = title;
    by_id('tour-text').textContent = text;
    by_id('tour-back').disabled = this.step === 0;
    by_id('tour-next').textContent = this.step + 1 < kSteps.length ? 'Next' : 'Finish';
    this.show(true);
    this.show_progress();
  }

  /** Chooses all that the step is about; what stands already is not sent again. */
  set_up() {
    const {method, settings} = this.current;
    const sent = Object.entries(settings).filter(([name]) => this.settings.can_set(name))
        .map(([name, value]) => this.settings.value(name) === value ||
                                this.settings.send(name, value) !== null);
    const index = (this.hello.methods || []).findIndex((name) => name.split(' ')[0] === method);
    const chosen = index < 0 || this.connection.send('method', {method: index}) !== null;
    this.ready = chosen && sent.every(Boolean);
    if (this.ready) {
      this.visited.push(this.current.key);
    }
  }

  stay(stays) {
    this.stays = stays;
    by_id('tour-stay').setAttribute('aria-pressed', String(stays));
  }

  tick(now_ms) {
    const passed_s = (now_ms - this.last_ms) / 1000;
    this.last_ms = now_ms;
    if (this.step < 0 || !this.ready || this.stays) {
      return;  // time passes only while the step is to be seen
    }
    this.left_s -= passed_s;
    this.show_progress();
    if (this.left_s <= 0) {
      this.go(this.step + 1);
    }
  }

  show_progress() {
    by_id('tour-progress').value = 1 - Math.max(0, this.left_s) / this.step_s;
  }

  quit() {
    this.quit_by_person = true;
    this.step = -1;
    this.show(false);
  }

  show(shown) {
    if (by_id('tour').hidden === shown) {
      by_id('tour').hidden = !shown;
      this.on_resize();
    }
  }
}
