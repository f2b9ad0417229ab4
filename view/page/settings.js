// SPDX-License-Identifier: Apache-2.0
// What can be changed while the run goes on: budget, requests, the simulator's link, the hand, the
// scene. What it shows is what the run says; the line below is what the servo measures.

const kNoLimit = 1e30;  // what a float of the scope has for infinity
const kRateOver_s = 2;

const element = (name, properties = {}, ...children) => {
  const made = Object.assign(document.createElement(name), properties);
  made.append(...children);
  return made;
};

const short = (value) => Number(value.toPrecision(3)).toString();

/** A row of the list: a label, and what changes the setting. */
class Row {
  constructor(setting, send) {
    this.send = send;
    this.name = setting.name;
    this.root = element('div', {className: 'setting'});
    this.root.dataset.setting = setting.name;
    const id = `setting-${setting.name}`;
    const label = element('label', {htmlFor: id, textContent: setting.label});
    this.fields = setting.choices ? [this.make_choice(setting)] : this.make_number(setting);
    this.fields[0].id = id;
    this.root.append(label, ...this.fields);
    if (setting.unit) {
      this.root.append(element('span', {className: 'unit', textContent: setting.unit}));
    }
    if (setting.none !== undefined) {
      this.none = element('input', {type: 'checkbox'});
      this.none.addEventListener('change', () => this.ask(
          this.none.checked ? null : Number(this.number.value || setting.high)));
      this.root.append(element('label', {className: 'none'}, this.none, ` ${setting.none}`));
    }
    if (setting.why_not) {
      this.root.append(element('span', {className: 'why-not', textContent: setting.why_not}));
    }
    this.take(setting);
  }

  make_choice(setting) {
    this.choice = element('select');
    this.choice.append(...setting.choices.map((name) => new Option(name, name)));
    this.choice.addEventListener('change', () => this.ask(this.choice.value));
    return this.choice;
  }

  /** A slider and a number, for the keyboard. Nothing is sent while the slider moves. */
  make_number(setting) {
    const limits = {min: setting.low, max: setting.high, step: 'any'};
    this.number = element('input', {type: 'number', ...limits});
    this.slider = element('input', {type: 'range', ...limits, tabIndex: -1, ariaHidden: 'true'});
    this.slider.addEventListener('input', () => {
      this.number.value = short(this.slider.valueAsNumber);
    });
    for (const field of [this.slider, this.number]) {
      field.addEventListener('change', () => {
        if (Number.isFinite(field.valueAsNumber)) {
          this.ask(Number(short(field.valueAsNumber)));
        } else {
          this.take(this.setting);
        }
      });
    }
    return [this.number, this.slider];
  }

  ask(value) {
    if (this.send(this.name, value) === null) {
      this.take(this.setting);
    }
  }

  /** How the run says that it stands. */
  take(setting) {
    this.setting = setting;
    this.set_waiting(false);
    const {value} = setting;
    if (this.none) {
      this.none.checked = value === null;
    }
    if (this.choice) {
      this.choice.value = value;
    } else if (value !== null) {
      this.number.value = short(value);
      this.slider.value = value;
    } else {
      this.number.value = '';
      this.slider.value = setting.high;
    }
  }

  set_waiting(waiting) {
    this.root.dataset.waiting = String(waiting);
    this.root.setAttribute('aria-busy', String(waiting));
  }

  set_allowed(allowed) {
    this.root.querySelectorAll('input, select').forEach((field) => {
      field.disabled = !allowed || Boolean(this.setting.why_not);
    });
  }
}

export class Settings {
  /** @param menu the <details>; its list, and the line for what is measured. */
  constructor(connection, {menu, list, measured}) {
    this.connection = connection;
    this.menu = menu;
    this.list = list;
    this.measured_line = measured;
    this.rows = new Map();
    this.asked = new Map();  // name by the id of a command that is not answered yet
    this.acknowledged = 0;
    this.refused = 0;
  }

  set_run(hello) {
    this.asked.clear();
    this.rows.clear();
    const settings = (hello.controls || []).includes('set') ? hello.settings || [] : [];
    settings.forEach((setting) => this.rows.set(
        setting.name, new Row(setting, (name, value) => this.send(name, value))));
    this.list.replaceChildren(...[...this.rows.values()].map((row) => row.root));
    this.menu.hidden = settings.length === 0;
    this.set_allowed(this.allowed);
  }

  set_allowed(allowed) {
    this.allowed = allowed;
    this.rows.forEach((row) => row.set_allowed(allowed));
  }

  /** The id of the command, or null without a connection or without such a setting. */
  send(name, value) {
    const row = this.rows.get(name);
    const id = row && this.allowed ? this.connection.send('set', {name, value}) : null;
    if (id !== null) {
      this.asked.set(id, name);
      row.set_waiting(true);
    }
    return id;
  }

  /** A settings message: how they all stand. */
  on_settings({settings}) {
    settings.forEach((setting) => {
      const row = this.rows.get(setting.name);
      if (row && !this.is_asked(setting.name)) {
        row.take(setting);
      } else if (row) {
        row.setting = setting;
      }
    });
  }

  is_asked(name) {
    return [...this.asked.values()].includes(name);
  }

  on_acknowledged(message) {
    const name = this.asked.get(message.id);
    if (message.what !== 'set' || name === undefined) {
      return;
    }
    this.asked.delete(message.id);
    this[message.done ? 'acknowledged' : 'refused'] += 1;
    if (!this.is_asked(name)) {
      const row = this.rows.get(name);
      row.take(row.setting);  // the settings message came before
    }
  }

  value(name) {
    const row = this.rows.get(name);
    return row ? row.setting.value : undefined;
  }

  /** [m] Height of the wall in W; null: there is none. */
  get wall_m() {
    const wall_mm = this.value('wall_mm');
    return Number.isFinite(wall_mm) ? wall_mm / 1000 : null;
  }

  /** Whether this run has it, and can change it. */
  can_set(name) {
    const row = this.rows.get(name);
    return row !== undefined && !row.setting.why_not;
  }

  /** What the servo's own telemetry says of the newest moments. */
  measured(history) {
    const end = history.end - 1;
    const begin = Math.max(history.first, history.row_at(history.newest_s - kRateOver_s));
    const passed_s = end > begin ? history.time(end) - history.time(begin) : NaN;
    const rate = (history.value(end, 'arrivals') - history.value(begin, 'arrivals')) / passed_s;
    return {arrivals_per_s: rate, sample_period_ms: history.newest('sample_period_ms'),
            sample_age_ms: history.newest('sample_age_ms'),
            requests_per_s: history.newest('requests_per_s'),
            budget_reads: history.newest('budget_reads')};
  }

  show_measured(history) {
    if (!this.menu.open || history.rows === 0) {
      return;
    }
    const now = this.measured(history);
    const words = [
      Number.isFinite(now.arrivals_per_s) &&
          `${now.arrivals_per_s.toFixed(0)} samples and answers/s`,
      Number.isFinite(now.sample_age_ms) && `newest ${now.sample_age_ms.toFixed(0)} ms old`,
      Number.isFinite(now.requests_per_s) && `up to ${short(now.requests_per_s)} requests/s`,
      now.budget_reads > 0 && (now.budget_reads < kNoLimit
          ? `budget ${short(now.budget_reads)} reads a cycle` : 'no limit of the budget'),
    ].filter(Boolean);
    this.measured_line.textContent = words.join(' · ');
  }
}
