// SPDX-License-Identifier: Apache-2.0
// Parts of the picture that the live view sends only to pages that show them.

const by_id = (id) => document.getElementById(id);

export class Layers {
  constructor(connection, scene) {
    this.connection = connection;
    this.scene = scene;
    this.blocks = by_id('blocks');
    this.blocks.addEventListener('change', () => this.ask());
  }

  /** Another run, or another connection to the same one. */
  set_run(hello) {
    this.blocks.disabled = hello.blocks !== true;
    this.ask();
  }

  get shows_blocks() {
    return this.blocks.checked && !this.blocks.disabled;
  }

  ask() {
    this.scene.set_blocks(null);
    this.show_counts();
    this.connection.send('layers', {blocks: this.shows_blocks}, true);
  }

  take_blocks(message) {
    if (this.shows_blocks) {
      this.scene.set_blocks(message);
      this.show_counts();
    }
  }

  show_counts() {
    const {in_use} = this.scene.blocks;
    by_id('blocks-count').textContent =
        !this.shows_blocks || in_use === null ? '' : in_use > 0 ? `(${in_use})` : '(none in use)';
  }
}
