// SPDX-License-Identifier: Apache-2.0
// What the person wants to see of the force field, and the words beside it.

import {kQuantities} from '/field.js';

const kSize_m = 0.06;
const kPoints = 33;

const by_id = (id) => document.getElementById(id);

/** Fills a list with [value, word] pairs and keeps what was chosen if it is still there. */
function fill(list, pairs) {
  const chosen = list.value;
  list.replaceChildren(...pairs.map(([value, word]) => {
    const option = document.createElement('option');
    option.value = value;
    option.textContent = word;
    return option;
  }));
  if (pairs.some(([value]) => String(value) === chosen)) {
    list.value = chosen;
  }
}

export class FieldChoice {
  constructor(connection, scene) {
    this.connection = connection;
    this.scene = scene;
    this.methods = [];
    this.inexact = '';
    this.method = by_id('field-method');
    this.compared = by_id('field-compared');
    this.quantity = by_id('field-quantity');
    this.normal = by_id('field-normal');
    fill(this.quantity, Object.entries(kQuantities).map(([key, {word}]) => [key, word]));
    [this.method, this.compared, this.normal].forEach((list) => {
      list.addEventListener('change', () => this.ask());
    });
    this.cells = by_id('field-cells');
    this.cells.addEventListener('change', () => this.show_cells());
    this.directions = by_id('field-directions');
    this.directions.addEventListener('change', () => {
      this.scene.field.directions.set_wanted(this.directions.checked);
      this.scene.dirty = true;
    });
    this.quantity.addEventListener('change', () => {
      this.scene.set_field_quantity(this.quantity.value);
      this.show_scale();
    });
  }

  /** Another run: its methods. */
  set_run(hello) {
    this.methods = hello.methods || [];
    this.inexact = hello.recording ? 'about' : 'from when the view joined';
    this.scene.field.largest_N = hello.largest_force_N > 0 ? hello.largest_force_N : Infinity;
    this.scene.field.grid = hello.grid || null;
    this.show_cells();
    by_id('field').disabled = hello.field !== true;
    const names = this.methods.map((name, i) => [i, name]);
    fill(this.method, [['', 'no method'], ...names]);
    fill(this.compared, [['', 'nothing'], ...names]);
    this.ask();
  }

  show_cells() {
    this.scene.field.show_cells(this.cells.checked);
    this.scene.dirty = true;
  }

  get wanted() {
    return this.method.value !== '' && !by_id('field').disabled;
  }

  ask() {
    this.scene.set_field(null);
    this.show_scale();
    if (!this.wanted) {
      this.connection.send('field', {method: null}, true);
      return;
    }
    this.connection.send('field', {
      method: Number(this.method.value),
      compared: this.compared.value === '' ? null : Number(this.compared.value),
      normal: Number(this.normal.value), size_m: kSize_m, points: kPoints,
    }, true);
  }

  /** A slice that came. */
  take(message) {
    if (this.wanted) {
      this.scene.set_field(message);
      this.show_scale();
    }
  }

  show_scale() {
    const {field} = this.scene;
    const {word, unit} = kQuantities[this.quantity.value];
    const less = this.compared.value === '' ? '' : ` − ${this.methods[this.compared.value]}`;
    by_id('field-scale').hidden = !field.mesh.visible;
    by_id('field-word').textContent = `${word} of ${this.methods[this.method.value] || ''}${less}` +
        (field.message && !field.message.exact ? ` (${this.inexact})` : '');
    by_id('field-top').textContent = `${field.top_N.toPrecision(2)} ${unit}`;
  }
}
