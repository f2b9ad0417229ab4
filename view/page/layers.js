// SPDX-License-Identifier: Apache-2.0
// Parts of the picture that the live view sends only to pages that show them.

const kWaitForInside_ms = 2000;  // then its simulator sends none
const kMostEdges = 300000;       // that a simulator sends

const by_id = (id) => document.getElementById(id);
const number = (count) => count.toLocaleString('en');

export class Layers {
  constructor(connection, scene) {
    this.connection = connection;
    this.scene = scene;
    this.blocks = by_id('blocks');
    this.inside = by_id('inside');
    this.is_recording = false;
    this.late = 0;  // timer; 0: the inside is not waited for any more
    this.blocks.addEventListener('change', () => this.ask());
    this.inside.addEventListener('change', () => this.ask());
  }

  /** Another run, or another connection to the same one. */
  set_run(hello) {
    this.blocks.disabled = hello.blocks !== true;
    this.inside.disabled = hello.inside !== true;
    this.is_recording = hello.recording !== undefined;
    this.ask();
  }

  get shows_blocks() {
    return this.blocks.checked && !this.blocks.disabled;
  }

  get shows_inside() {
    return this.inside.checked && !this.inside.disabled;
  }

  ask() {
    this.scene.set_blocks(null);
    this.scene.show_inside(this.shows_inside);
    clearTimeout(this.late);
    this.late = setTimeout(() => {
      this.late = 0;
      this.show_counts();
    }, kWaitForInside_ms);
    this.show_counts();
    this.connection.send('layers', {blocks: this.shows_blocks, inside: this.shows_inside}, true);
  }

  take_blocks(message) {
    if (this.shows_blocks) {
      this.scene.set_blocks(message);
      this.show_counts();
    }
  }

  take_inside_lines(message) {
    if (this.shows_inside) {
      this.scene.set_inside_lines(message);
      this.show_counts();
    }
  }

  show_counts() {
    const {in_use} = this.scene.blocks;
    by_id('blocks-count').textContent =
        !this.shows_blocks || in_use === null ? '' : in_use > 0 ? `(${in_use})` : '(none in use)';
    by_id('inside-count').textContent = this.inside_text();
  }

  /** What is inside, or why nothing is shown. */
  inside_text() {
    if (this.is_recording) {
      return '(not in a recording)';
    }
    if (!this.shows_inside) {
      return '';
    }
    const {insides} = this.scene;
    if (insides.objects.size === 0) {
      return this.late ? '' : '(its simulator sends none)';
    }
    const [springs, edges] = [insides.sum('springs'), insides.sum('element_edges')];
    const counts = [springs > 0 && `${number(springs)} springs`,
                    edges > 0 && `${number(edges)} edges of tetrahedra`].filter(Boolean);
    const too_large = [...insides.objects.values()].some((inside) => inside.is_too_large);
    return `(${counts.join(', ') || 'none'}` +
        `${too_large ? `: too many, at most ${number(kMostEdges)} of an object are shown` : ''})`;
  }
}
