# SPDX-License-Identifier: Apache-2.0
"""Scripts for a page: which texts can't be read, what covers what; sizes of windows for them."""

# Texts with a contrast below 4.5 to what is behind them.
CONTRAST = """
const canvas = document.createElement('canvas').getContext('2d', {willReadFrequently: true});
const rgba = (colour) => {
  canvas.clearRect(0, 0, 1, 1);
  canvas.fillStyle = colour;
  canvas.fillRect(0, 0, 1, 1);
  return [...canvas.getImageData(0, 0, 1, 1).data];
};
const over = (top, below) => [0, 1, 2].map(
    (i) => top[i] * top[3] / 255 + below[i] * (1 - top[3] / 255));
const background = (element) => {
  if (!element) return rgba(getComputedStyle(document.body).backgroundColor);
  const own = rgba(getComputedStyle(element).backgroundColor);
  return own[3] === 255 ? own : [...over(own, background(element.parentElement)), 255];
};
const light = (colour) => {
  const [r, g, b] = colour.map((c) => c / 255).map(
      (c) => c <= 0.04045 ? c / 12.92 : ((c + 0.055) / 1.055) ** 2.4);
  return 0.2126 * r + 0.7152 * g + 0.0722 * b;
};
const poor = [];
let seen = 0;
for (const element of document.querySelectorAll('body *')) {
  const own = [...element.childNodes].some(
      (node) => node.nodeType === 3 && node.textContent.trim());
  if (!own || !element.checkVisibility() || element.closest(':disabled')) continue;
  const behind = background(element);
  const front = over(rgba(getComputedStyle(element).color), behind);
  const [a, b] = [light(front), light(behind)].sort((p, q) => q - p);
  seen += 1;
  const contrast = (a + 0.05) / (b + 0.05);
  if (contrast < 4.5) {
    poor.push(`${element.tagName}.${element.className} '${element.textContent}' ${contrast}`);
  }
}
return {seen, poor};
"""


# Texts and controls that cover each other, and those that leave the window at its sides. What a
# box that scrolls hides does not count, nor what lies over the page on purpose.
OVERLAPS = """
const clipped = (inside, rect) => {
  let {left, top, right, bottom} = rect;
  for (let box = inside; box; box = box.parentElement) {
    const style = getComputedStyle(box);
    if (box !== document.body && style.overflow !== 'visible') {
      const edge = box.getBoundingClientRect();
      left = Math.max(left, edge.left);
      right = Math.min(right, edge.right);
      top = Math.max(top, edge.top);
      bottom = Math.min(bottom, edge.bottom);
    }
    if (style.position === 'fixed') break;
  }
  return {left, top, right, bottom};
};
const parts = [];
const add = (inside, rect, word) => {
  const seen = clipped(inside, rect);
  if (seen.right - seen.left > 1 && seen.bottom - seen.top > 1) {
    parts.push({word, ...seen});
  }
};
const range = document.createRange();
for (const element of document.querySelectorAll('body *')) {
  if (!element.checkVisibility({checkVisibilityCSS: true}) || element.closest(
      '.chart, .hidden-word, option, dialog, .menu-list, .note-list')) continue;
  if (getComputedStyle(element.closest('.stop') || element).position === 'fixed') continue;
  if (element.matches('button, select, input, summary')) {
    add(element.parentElement, element.getBoundingClientRect(), element.id || element.textContent.trim());
  } else if (!element.closest('button, select, summary')) {
    for (const node of element.childNodes) {
      if (node.nodeType === 3 && node.data.trim()) {
        range.selectNodeContents(node);
        add(element, range.getBoundingClientRect(), node.data.trim());
      }
    }
  }
}
const found = [];
parts.forEach((a, i) => {
  if (a.left < -1 || a.right > innerWidth + 1) found.push(`${a.word} leaves the window`);
  for (const b of parts.slice(i + 1)) {
    const width = Math.min(a.right, b.right) - Math.max(a.left, b.left);
    const height = Math.min(a.bottom, b.bottom) - Math.max(a.top, b.top);
    if (width > 1 && height > 1) {
      found.push(`'${a.word}' and '${b.word}': ${width.toFixed(0)} x ${height.toFixed(0)} px`);
    }
  }
});
return {seen: parts.length, found};
"""
# Wide, low, between two layouts, narrow.
SIZES_PX = [(1280, 720), (1920, 1080), (1024, 400), (901, 600), (861, 500), (860, 500), (640, 900),
            (480, 800), (400, 800), (320, 640)]
