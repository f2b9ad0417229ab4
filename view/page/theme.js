// SPDX-License-Identifier: Apache-2.0
// Dark and light. The colours stand in style.css; pictures and charts read them from there.

const kKey = 'forcegrid_theme';

function remembered() {
  try {
    return localStorage.getItem(kKey);
  } catch {
    return null;  // storage is forbidden: the system's choice holds
  }
}

function remember(theme) {
  try {
    localStorage.setItem(kKey, theme);
  } catch {
    // The next visit begins with the system's choice.
  }
}

/** The colours that scripts draw with. */
export function palette() {
  const style = getComputedStyle(document.documentElement);
  const read = (name) => style.getPropertyValue(`--${name}`).trim();
  const list = (name, count) => Array.from({length: count}, (_, i) => read(`${name}-${i}`));
  const candidates = list('candidate', 8);
  return {
    backdrop: read('backdrop'), arm: read('arm'), tool: read('tool'), touch: read('touch'),
    accent: read('accent'), workspace: read('workspace'), mesh: read('mesh'),
    free_sample: read('free-sample'), touch_sample: read('touch-sample'),
    commanded: read('commanded'), series: list('series', 4), ramp: list('ramp', 4),
    grid: read('grid'), contact: read('contact'), deadline: read('deadline'), text: read('text'),
    panel: read('panel'), axes: list('axis', 3), on_candidate: read('on-candidate'),
    of: read, candidate: (index) => candidates[index % candidates.length],
  };
}

/** Follows the system's choice until the button is pressed. Calls changed(palette) each time. */
export function start_theme(button, changed) {
  const light = matchMedia('(prefers-color-scheme: light)');
  const apply = (theme) => {
    const other = theme === 'dark' ? 'Light theme' : 'Dark theme';
    document.documentElement.dataset.theme = theme;
    button.setAttribute('aria-label', other);
    button.title = other;
    changed(palette());
  };
  apply(remembered() || (light.matches ? 'light' : 'dark'));
  light.addEventListener('change', () => {
    if (!remembered()) {
      apply(light.matches ? 'light' : 'dark');
    }
  });
  button.addEventListener('click', () => {
    const theme = document.documentElement.dataset.theme === 'dark' ? 'light' : 'dark';
    remember(theme);
    apply(theme);
  });
}
