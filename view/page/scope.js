// SPDX-License-Identifier: Apache-2.0
// The scope: panels over one time axis, which follows the newest row or stands still.

import {Panel} from '/panel.js';
import {when_resized} from '/resized.js';

const kMethods = 4;
const kAxes = ['x', 'y', 'z'];

/** What the panels show, from the hello message. */
function panel_specs(hello) {
  const names = new Set(hello.columns || []);
  const methods = (hello.methods || []).slice(0, kMethods);
  const force = (prefix) => kAxes.map((axis) => `${prefix}_${axis}_N`);
  const plain = (label, colour, column, more = {}) =>
      ({label, colour, kind: 'plain', columns: [column], ...more});
  const specs = [
    {
      key: 'force',
      title: 'Force',
      unit: 'N',
      digits: 2,
      zero: true,
      band: true,
      components: true,
      series: [
        {
          label: 'commanded',
          colour: 'commanded',
          kind: 'norm',
          all: force('force'),
          columns: force('force'),
          arrow: 0,
          role: 'the force on the hand, after every limit'
        },
        ...methods.map((method, i) => ({
                         label: method,
                         colour: `series-${i}`,
                         kind: 'norm',
                         all: force(`method${i}`),
                         columns: force(`method${i}`),
                         arrow: i + 1,
                         role: i === 0 ? 'rendered' : 'evaluated, not rendered'
                       }))
      ]
    },
    {
      key: 'position',
      title: 'Position',
      unit: 'mm',
      digits: 1,
      series: kAxes.map((axis, i) => plain(axis, `axis-${i}`, `position_${axis}_mm`))
    },
    {
      key: 'timing',
      title: 'Timing',
      unit: 'µs',
      digits: 0,
      log: true,
      deadline_us: hello.rate_Hz > 0 ? 1e6 / hello.rate_Hz : 0,
      series: [
        plain('period', 'series-0', 'period_max_us', {positive: true, role: 'longest in 10 ms'}),
        plain('wake-up', 'series-1', 'wakeup_max_us', {positive: true, role: 'latest in 10 ms'}),
        plain('compute', 'series-2', 'compute_max_us', {positive: true})
      ]
    },
    {
      key: 'age',
      title: 'Age',
      unit: 'ms',
      digits: 1,
      zero: true,
      series: [
        plain('sample', 'series-0', 'sample_age_ms', {positive: true}),
        plain('report', 'series-1', 'report_age_us', {factor: 1e-3})
      ]
    },
    {
      key: 'energy',
      title: 'Energy to the hand',
      unit: 'mJ',
      digits: 2,
      zero: true,
      series: [plain('energy', 'series-0', 'energy_mJ')]
    },
  ];
  specs.forEach((spec) => {
    spec.series = spec.series.filter((series) => series.columns.every((name) => names.has(name)));
  });
  return specs.filter((spec) => spec.series.length > 0);
}

export class Scope {
  /**
   * @param elements {panels, chips, window_s, freeze}: the page's elements.
   * @param on_arrow(index, shown) called when a force is shown or hidden.
   */
  constructor(history, elements, on_arrow) {
    this.history = history;
    this.elements = elements;
    this.on_arrow = on_arrow;
    this.hello = {};
    this.panels = [];
    this.open = new Set(['force', 'position', 'timing']);
    this.palette = null;
    this.frozen_s = null;  // [from, to], or null: follows
    this.held = false;
    this.cursor_px = null;
    this.cursor_s = null;
    this.next_panel = 0;
    this.changed = true;
    elements.window_s.addEventListener('change', () => this.follow());
    elements.freeze.addEventListener(
        'click', () => (this.frozen_s ? this.follow() : this.freeze()));
    addEventListener('pointerup', () => this.hold(false));
    addEventListener('pointercancel', () => this.hold(false));
    when_resized(elements.panels, () => this.resize());
  }

  set_run(hello) {
    this.hello = hello;
    this.panels.forEach((panel) => panel.destroy());
    this.panels = panel_specs(hello).map((spec) => new Panel(spec, this));
    this.elements.panels.replaceChildren(...this.panels.map((panel) => panel.root));
    this.elements.chips.replaceChildren(...this.panels.map((panel) => this.chip(panel)));
    this.arrange();
    this.follow();
  }

  chip(panel) {
    const button = document.createElement('button');
    button.type = 'button';
    button.className = 'chip';
    button.textContent = panel.spec.title.split(' ')[0];
    button.title = `${panel.spec.title}: show or hide`;
    button.dataset.chip = panel.spec.key;
    button.addEventListener('click', () => {
      this.open[this.open.has(panel.spec.key) ? 'delete' : 'add'](panel.spec.key);
      this.arrange();
    });
    return button;
  }

  arrange() {
    this.panels.forEach((panel, i) => {
      const open = this.open.has(panel.spec.key);
      panel.root.hidden = !open;
      this.elements.chips.children[i].setAttribute('aria-pressed', String(open));
    });
    this.resize();
  }

  resize() {
    this.panels.forEach((panel) => {
      if (panel.graph && !panel.root.hidden && panel.chart.clientHeight >= 30) {
        panel.graph.resize();
      }
    });
    this.redraw();
  }

  set_theme(palette) {
    this.palette = palette;
    this.panels.forEach((panel) => {
      panel.destroy();
    });
    this.redraw();
  }

  get window_s() {
    if (this.frozen_s) {
      return this.frozen_s;
    }
    const length_s = Number(this.elements.window_s.value);
    return [this.history.newest_s - length_s, this.history.newest_s];
  }

  freeze(window_s = this.window_s) {
    this.frozen_s = [...window_s];
    this.show_frozen();
    this.redraw();
  }

  follow() {
    this.frozen_s = null;
    this.show_frozen();
    this.redraw();
  }

  show_frozen() {
    this.elements.freeze.setAttribute('aria-pressed', String(this.frozen_s !== null));
    this.elements.freeze.textContent = this.frozen_s ? 'Follow' : 'Freeze';
  }

  /** While a button is held in a chart, it stands still. */
  hold(held) {
    this.held = held;
  }

  /** A chart was drawn: if a person zoomed or moved it, all stand still at its range. */
  on_range(panel, [from_s, to_s]) {
    const [shown_from_s, shown_to_s] = panel.asked_s || [from_s, to_s];
    const tolerance_s = 1e-6 * (to_s - from_s);
    if (Math.abs(from_s - shown_from_s) > tolerance_s ||
        Math.abs(to_s - shown_to_s) > tolerance_s) {
      panel.asked_s = [from_s, to_s];
      this.frozen_s = [from_s, to_s];
      this.show_frozen();
      this.changed = true;
    }
  }

  set_cursor(px) {
    this.cursor_px = px;
    this.panels.filter((panel) => panel.graph).forEach((panel) => panel.place_cursor());
    this.read_cursor();
    this.panels.forEach((panel) => panel.show_values());
  }

  read_cursor() {
    const panel = this.panels.find((one) => one.graph && !one.root.hidden);
    this.cursor_s =
        panel && this.cursor_px !== null ? panel.graph.toDataXCoord(this.cursor_px) : null;
  }

  /** Draws all panels at the next opportunity. */
  redraw() {
    this.changed = true;
    this.draw_all();
  }

  draw_all() {
    if (this.palette && this.history.rows > 1) {
      this.changed = false;
      this.panels.forEach((panel) => this.draw_panel(panel));
    }
  }

  /** Draws one panel, in turn; the charts share the time that drawing takes among pictures. */
  draw_next() {
    const open = this.panels.filter((panel) => !panel.root.hidden);
    if (open.length === 0 || this.held || !this.palette) {
      return;
    }
    if (this.changed && this.frozen_s) {
      this.draw_all();
    } else if (!this.frozen_s) {
      this.draw_panel(open[this.next_panel++ % open.length]);
    }
  }

  draw_panel(panel) {
    if (!panel.root.hidden && this.history.rows > 1) {
      panel.asked_s = this.window_s;
      this.read_cursor();
      panel.draw(...panel.asked_s);
    }
  }
}
