// SPDX-License-Identifier: Apache-2.0
// The WebSocket to the live view: opens it, opens it again when it is lost, numbers commands.

const kFirstWait_ms = 250;
const kLongestWait_ms = 5000;
const kWaitGrowth = 1.6;
const kLongestBuffered_bytes = 64 * 1024;

export class Connection {
  /**
   * @param handlers {on_open(), on_text(object), on_binary(ArrayBuffer, arrived_ms), on_lost()}
   */
  constructor(handlers) {
    this.handlers = handlers;
    this.socket = null;
    this.next_id = 1;
    this.wait_ms = kFirstWait_ms;
  }

  get url() {
    const token = new URLSearchParams(location.search).get('token') || '';
    const scheme = location.protocol === 'https:' ? 'wss:' : 'ws:';
    return `${scheme}//${location.host}/ws?token=${encodeURIComponent(token)}`;
  }

  get open() {
    return this.socket !== null && this.socket.readyState === WebSocket.OPEN;
  }

  connect() {
    const socket = new WebSocket(this.url);
    socket.binaryType = 'arraybuffer';
    socket.onopen = () => this.handlers.on_open();
    socket.onmessage = (event) => this.receive(event.data);
    socket.onclose = () => this.retry(socket);
    this.socket = socket;
  }

  receive(data) {
    this.wait_ms = kFirstWait_ms;
    if (typeof data !== 'string') {
      this.handlers.on_binary(data, performance.now());
      return;
    }
    let message = null;
    try {
      message = JSON.parse(data);
    } catch {
      message = {type: 'note', level: 'warn', component: 'page',
                 text: 'the live view sent a text that is no JSON; it is ignored'};
    }
    this.handlers.on_text(message);
  }

  retry(socket) {
    if (socket !== this.socket) {
      return;
    }
    this.socket = null;
    this.handlers.on_lost();
    setTimeout(() => this.connect(), this.wait_ms);
    this.wait_ms = Math.min(kLongestWait_ms, this.wait_ms * kWaitGrowth);
  }

  /** Nobody is expected to be there soon. */
  slow_down() {
    this.wait_ms = kLongestWait_ms;
  }

  /**
   * Sends a command. Returns its id, or null without a connection. `droppable` commands are left
   * out while much is still unsent.
   */
  send(what, fields = {}, droppable = false) {
    if (!this.open || (droppable && this.socket.bufferedAmount > kLongestBuffered_bytes)) {
      return null;
    }
    const id = this.next_id++;
    this.socket.send(JSON.stringify({id, what, ...fields}));
    return id;
  }
}
