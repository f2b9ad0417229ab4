// SPDX-License-Identifier: Apache-2.0
// Files of what the page shows: rows as CSV, a picture as PNG.

/** A name with the time, such as forcegrid_2026-03-05_14-07-31.csv. */
function file_name(ending) {
  const now = new Date();
  const two = (number) => String(number).padStart(2, '0');
  return `forcegrid_${now.getFullYear()}-${two(now.getMonth() + 1)}-${two(now.getDate())}_` +
         `${two(now.getHours())}-${two(now.getMinutes())}-${two(now.getSeconds())}.${ending}`;
}

function save(blob, name) {
  const link = document.createElement('a');
  link.href = URL.createObjectURL(blob);
  link.download = name;
  link.click();
  setTimeout(() => URL.revokeObjectURL(link.href), 10000);
}

/** Saves the rows that the scope shows if it stands still, else all that the page keeps. */
export function save_csv(history, frozen_s) {
  const [from_s, to_s] = frozen_s || [-Infinity, Infinity];
  save(new Blob([history.csv(from_s, to_s)], {type: 'text/csv'}), file_name('csv'));
}

const kNotInPictures = '.scope-bar, .hud-tools, .empty';

function draw_text(context, element, text, place) {
  const style = getComputedStyle(element);
  context.font = `${style.fontWeight} ${style.fontSize} ${style.fontFamily}`;
  context.fillStyle = style.color;
  context.fillText(text, place.left, place.top + place.height / 2);
}

/** Draws the text of `root`, where the page has it. */
function copy_texts(context, root) {
  const walker = document.createTreeWalker(root, NodeFilter.SHOW_TEXT);
  const range = document.createRange();
  context.textBaseline = 'middle';
  while (walker.nextNode()) {
    const node = walker.currentNode;
    const element = node.parentElement;
    if (node.data.trim() !== '' && !element.closest(`${kNotInPictures}, select`) &&
        element.checkVisibility()) {
      range.selectNodeContents(node);
      draw_text(context, element, node.data.trim(), range.getBoundingClientRect());
    }
  }
  root.querySelectorAll('.panel:not([hidden]) select').forEach((choice) => {
    draw_text(context, choice, choice.selectedOptions[0].text, choice.getBoundingClientRect());
  });
}

/** Draws the lines beside the names of the curves, and what the colours stand for. */
function copy_keys(context, root, palette) {
  root.querySelectorAll('.series[aria-pressed=true]').forEach((button) => {
    const place = button.getBoundingClientRect();
    context.fillStyle = palette.of(button.dataset.colour);
    context.fillRect(place.left + 5, place.top + place.height / 2 - 1.5, 10, 3);
  });
  root.querySelectorAll('.ramp').forEach((ramp) => {
    const place = ramp.getBoundingClientRect();
    if (place.width > 0) {
      const colours = context.createLinearGradient(place.left, 0, place.right, 0);
      palette.ramp.forEach((colour, i) => colours.addColorStop(i / 3, colour));
      context.fillStyle = colours;
      context.fillRect(place.left, place.top, place.width, place.height);
    }
  });
}

/** Saves the 3-D picture and the charts. `draw` draws the 3-D picture at once. */
export function save_png(main, palette, draw) {
  const place = main.getBoundingClientRect();
  const canvas = document.createElement('canvas');
  const scale = Math.max(1, devicePixelRatio);
  canvas.width = Math.round(place.width * scale);
  canvas.height = Math.round(place.height * scale);
  const context = canvas.getContext('2d');
  context.scale(scale, scale);
  context.translate(-place.left, -place.top);
  context.fillStyle = palette.panel;
  context.fillRect(place.left, place.top, place.width, place.height);
  draw();  // in this task: the browser drops the picture after it
  main.querySelectorAll('canvas').forEach((drawing) => {
    const at = drawing.getBoundingClientRect();
    if (at.width > 0) {
      context.drawImage(drawing, at.left, at.top, at.width, at.height);
    }
  });
  copy_keys(context, main, palette);
  copy_texts(context, main);
  canvas.toBlob((blob) => save(blob, file_name('png')), 'image/png');
}
