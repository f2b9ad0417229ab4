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

/** Draws what the page shows of `element` and its charts into a context, moved by (left, top). */
function copy_charts(context, root, left, top) {
  root.querySelectorAll('.chart canvas').forEach((canvas) => {
    const place = canvas.getBoundingClientRect();
    context.drawImage(canvas, place.left - left, place.top - top, place.width, place.height);
  });
  const texts = '.dygraph-axis-label, .panel-title, .unit, .series-name, .series-value, .speaker';
  context.textBaseline = 'middle';
  root.querySelectorAll(texts).forEach((element) => {
    const place = element.getBoundingClientRect();
    const style = getComputedStyle(element);
    if (place.width > 0) {
      context.font = `${style.fontWeight} ${style.fontSize} ${style.fontFamily}`;
      context.fillStyle = style.color;
      context.textAlign = style.textAlign === 'right' ? 'right' : 'left';
      context.fillText(element.textContent, (style.textAlign === 'right' ? place.right : place.left) - left,
                       place.top + place.height / 2 - top);
    }
  });
}

/** Saves the 3-D picture and the charts. `draw` draws the 3-D picture at once. */
export function save_png(main, scene_canvas, palette, draw) {
  const place = main.getBoundingClientRect();
  const canvas = document.createElement('canvas');
  const scale = Math.max(1, devicePixelRatio);
  canvas.width = Math.round(place.width * scale);
  canvas.height = Math.round(place.height * scale);
  const context = canvas.getContext('2d');
  context.scale(scale, scale);
  context.fillStyle = palette.panel;
  context.fillRect(0, 0, place.width, place.height);
  draw();  // in this task: the browser drops the picture after it
  const scene = scene_canvas.getBoundingClientRect();
  context.drawImage(scene_canvas, scene.left - place.left, scene.top - place.top, scene.width,
                    scene.height);
  copy_charts(context, main, place.left, place.top);
  canvas.toBlob((blob) => save(blob, file_name('png')), 'image/png');
}
