// SPDX-License-Identifier: Apache-2.0
// Numbers and words of the page: the run's facts, the tool, flags, notes, the status line.

const kMostNotes = 100;
const kNamesOfAxes = ['x', 'y', 'z'];

function text_of(element, text) {
  if (element.textContent !== text) {
    element.textContent = text;
  }
}

const fixed = (value, digits) => Number.isFinite(value) ? value.toFixed(digits) : '–';

/** Does the newest row say that a person paused the force? */
export function is_paused(history, hello) {
  return history.newest('paused') > 0 ||
         (hello.held_back || [])[history.newest('held_back')] === 'paused';
}

export class Readouts {
  constructor() {
    this.by_id = (id) => document.getElementById(id);
    this.flags_shown = '';
    this.compass_shown = '';
  }

  /** @param draws does the browser draw in 3-D? @param recorded is a recording shown? */
  set_state(state, draws, recorded = false) {
    document.body.dataset.state = state;
    const pill = this.by_id('state');
    text_of(pill, state === 'live' && recorded ? 'recording' : state);
    pill.dataset.state = state;
    const words = {connecting: 'Connecting to the live view…',
                   waiting: 'Waiting for a run to connect.',
                   lost: 'The connection to the live view is lost. Trying again…',
                   ended: ''}[state] ||
                  (draws ? '' : 'No picture: this browser has no WebGL 2, or it is switched off.');
    text_of(this.by_id('empty'), words);
    this.by_id('empty').hidden = words === '';
  }

  set_run(hello) {
    const rates = [hello.rate_Hz && `servo ${hello.rate_Hz} Hz`,
                   hello.simulator_rate_Hz && `simulator ${hello.simulator_rate_Hz} Hz`];
    const facts = [['Device', hello.device], ['Scene', hello.scene],
                   ['Rates', rates.filter(Boolean).join(', ')]];
    this.by_id('facts').replaceChildren(
        ...facts.filter(([, value]) => value).map(([name, value]) => {
          const row = document.createElement('div');
          const term = document.createElement('dt');
          const words = document.createElement('dd');
          term.textContent = name;
          words.textContent = words.title = value;
          row.append(term, words);
          return row;
        }));
    document.title = `${hello.scene || hello.device || 'run'} – Forcegrid ` +
        (hello.recording ? `recording ${hello.recording.file}` : 'live view');
  }

  /** The newest row of the history; `live`: is it of this moment? */
  show_row(history, hello, live) {
    text_of(this.by_id('force'), fixed(history.newest('force_N'), 2));
    kNamesOfAxes.forEach((axis) => {
      text_of(this.by_id(`at-${axis}`), fixed(history.newest(`position_${axis}_mm`), 1));
    });
    const flags = live ? this.flags(history, hello)
                       : history.rows > 0 ? [['last values', 'old']] : [];
    const key = JSON.stringify(flags);
    if (key !== this.flags_shown) {
      this.flags_shown = key;
      this.by_id('flags').replaceChildren(...flags.map(([text, kind]) => {
        const flag = document.createElement('span');
        flag.className = 'flag';
        flag.dataset.kind = kind;
        flag.textContent = text;
        return flag;
      }));
    }
  }

  flags(history, hello) {
    const flags = [];
    const fault = history.newest('fault');
    const rung = history.newest('rung');
    const held_back = history.newest('held_back');
    const limits = history.newest('limits');
    const paused = is_paused(history, hello);
    if (fault > 0) {
      flags.push([`fault: ${(hello.faults || [])[fault] || fault}`, 'bad']);
    }
    if (history.newest('in_contact') > 0) {
      flags.push(['in contact', 'touch']);
    }
    if (paused) {
      flags.push(['force paused', 'warn']);
    } else if (held_back > 0) {
      flags.push([`no force: ${(hello.held_back || [])[held_back] || held_back}`, 'warn']);
    } else if (rung > 0) {
      flags.push([`${(hello.rungs || [])[rung] || `rung ${rung}`}`, 'warn']);
    }
    (hello.limits || []).forEach((name, bit) => {
      if ((limits >> bit) & 1) {
        flags.push([`limit: ${name}`, 'warn']);
      }
    });
    return flags;
  }

  clear_notes() {
    this.by_id('note-list').replaceChildren();
    delete this.by_id('newest-note').dataset.level;
    text_of(this.by_id('newest-note'), 'No notes');
  }

  /** Adds a note on top. The same one again is counted. */
  add_note({level, component, text}) {
    const words = `${component ? `${component}: ` : ''}${text}`;
    const list = this.by_id('note-list');
    let item = list.firstChild;
    if (!item || item.dataset.words !== words) {
      item = document.createElement('li');
      Object.assign(item.dataset, {level: level || 'info', words, times: 0});
      list.prepend(item);
      if (list.children.length > kMostNotes) {
        list.lastChild.remove();
      }
    }
    item.dataset.times = Number(item.dataset.times) + 1;
    item.textContent =
        item.dataset.times === '1' ? words : `${words} (${item.dataset.times} times)`;
    const newest = this.by_id('newest-note');
    newest.dataset.level = item.dataset.level;
    const others = list.children.length - 1;
    text_of(newest, others > 0 ? `${item.textContent}, and ${others} more` : item.textContent);
  }

  show_numbers(parts) {
    text_of(this.by_id('numbers'), parts.filter(Boolean).join('  ·  '));
  }

  /** What the colours and the arrows of the scene stand for. */
  show_scale({surfaces, force_scale, colouring}) {
    const full = Math.max(0, ...[...surfaces.values()].map((surface) => surface.full));
    const is_strain = colouring === 'strain';
    this.by_id('colours').hidden = full === 0;
    text_of(this.by_id('colours-word'), colouring);
    const top = Number((full * (is_strain ? 100 : 1000)).toPrecision(2));
    text_of(this.by_id('scale-top'), `${top} ${is_strain ? '%' : 'mm'}`);
    text_of(this.by_id('arrow-top'), `${force_scale.full} N`);
  }

  /** The directions of W's axes as the camera sees them. */
  draw_compass(camera, palette) {
    const elements = camera.matrixWorldInverse.elements;
    const shown = [...elements.slice(0, 11), ...palette.axes].join();
    if (shown === this.compass_shown) {
      return;
    }
    this.compass_shown = shown;
    const canvas = this.by_id('compass');
    const context = canvas.getContext('2d');
    const middle = canvas.width / 2;
    context.clearRect(0, 0, canvas.width, canvas.height);
    context.font = '600 24px system-ui, sans-serif';
    context.textAlign = 'center';
    context.textBaseline = 'middle';
    context.lineWidth = 5;
    context.lineCap = 'round';
    const axes = [0, 1, 2].map((axis) => ({axis, x: elements[4 * axis], y: -elements[4 * axis + 1],
                                           z: elements[4 * axis + 2]}));
    for (const {axis, x, y} of axes.sort((a, b) => a.z - b.z)) {
      context.strokeStyle = context.fillStyle = palette.axes[axis];
      context.beginPath();
      context.moveTo(middle, middle);
      context.lineTo(middle + 42 * x, middle + 42 * y);
      context.stroke();
      context.fillText(kNamesOfAxes[axis], middle + 58 * x, middle + 58 * y);
    }
  }
}
