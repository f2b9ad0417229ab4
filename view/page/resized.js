// SPDX-License-Identifier: Apache-2.0

/**
 * Calls `act` when the element has another size, after the browser has drawn it so: what `act` draws
 * anew by software takes some 50 ms, and what has changed the size, such as the word that the
 * motors are off, is not to wait for it.
 */
export function when_resized(element, act) {
  let waiting = false;
  new ResizeObserver(() => {
    if (!waiting) {
      waiting = true;
      setTimeout(() => {
        waiting = false;
        act();
      });
    }
  }).observe(element);
}
