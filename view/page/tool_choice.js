// SPDX-License-Identifier: Apache-2.0
// Which of several tools on the object the page shows the scope, the field and the controls of.

export class ToolChoice {
  /**
   * @param parts {label, list}: the list's label, hidden where there is one tool.
   * @param before_change called before another tool is asked for.
   */
  constructor(connection, {label, list}, before_change) {
    this.connection = connection;
    this.label = label;
    this.list = list;
    this.shown = 0;   // its place, as the newest hello says
    this.wanted = 0;  // that the person chose
    this.tools = [];
    list.addEventListener('change', () => {
      before_change();
      this.wanted = Number(list.value);
      if (this.connection.send('tool', {tool: this.wanted}) === null) {
        this.list.value = this.shown;
      }
    });
  }

  /** A new connection begins with the first tool. */
  on_open() {
    if (this.wanted !== 0) {
      this.connection.send('tool', {tool: this.wanted});
    }
  }

  set_run(hello) {
    this.shown = hello.tool || 0;
    this.list.value = this.shown;
  }

  /** @param message {tools: [{tool, device, live}]}. */
  take(message) {
    this.tools = message.tools;
    this.label.hidden = this.tools.length < 2;
    this.list.replaceChildren(...this.tools.map(({tool, device, live}) => new Option(
        device.replace(/^device (\d+): (emulated:)?/, '$1: ') + (live ? '' : ' (ended)'), tool)));
    this.list.value = this.shown;
  }

  /** The places of the tools that are drawn beside the one that is shown. */
  get others() {
    return new Set(this.tools.filter(({tool, live}) => live && tool !== this.shown)
                       .map(({tool}) => tool));
  }
}
