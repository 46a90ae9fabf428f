/** Icons as SVG text, 24 units square, in the current colour; a shape for every state, so that colour is never alone. */
const svg = (body) => `<svg viewBox="0 0 24 24" aria-hidden="true">${body}</svg>`;
const OCTAGON = "M7.5 1h9L23 7.5v9L16.5 23h-9L1 16.5v-9z";

export const icons = {
  play: svg('<circle cx="12" cy="12" r="11.5" fill="currentColor"/><path d="M9 6.5v11l9-5.500z" fill="var(--surface)"/>'),
  hold: svg('<circle cx="12" cy="12" r="11.5" fill="currentColor"/><path d="M8 7h3v10H8zM13.500 7h3v10h-3z" fill="var(--surface)"/>'),
  armed: svg('<circle cx="12" cy="12" r="10" fill="none" stroke="currentColor" stroke-width="3"/><circle cx="12" cy="12" r="5" fill="currentColor"/>'),
  ok: svg('<circle cx="12" cy="12" r="11.5" fill="currentColor"/><path d="M6.800 12.300l3.600 3.600 6.800-7.200" fill="none" stroke="var(--surface)" stroke-width="2.600"/>'),
  barred: svg('<g fill="none" stroke="var(--ink2)" stroke-width="2.400"><circle cx="12" cy="12" r="9.800"/><path d="M5.200 18.800L18.800 5.200"/></g>'),
  caution: svg('<path d="M12 .5L23.500 12 12 23.500.5 12z" fill="currentColor"/><path d="M12 6.500v7" stroke="#13202c" stroke-width="2.600"/><circle cx="12" cy="16.800" r="1.500" fill="#13202c"/>'),
  fault: svg('<path d="M12 1.500L23.500 22H.5z" fill="currentColor" stroke="currentColor" stroke-linejoin="round"/><path d="M12 9v6" stroke="var(--hole)" stroke-width="2.400"/><circle cx="12" cy="18.200" r="1.400" fill="var(--hole)"/>'),
  stop: svg(`<path d="${OCTAGON}" fill="currentColor"/><path d="M8.500 8.500h7v7h-7z" fill="var(--hole)"/>`),
  stopped: svg(`<path d="${OCTAGON}" fill="none" stroke="currentColor" stroke-width="2"/><path d="M8 8h8v8H8z" fill="currentColor"/>`),
  unknown: svg(`<path d="${OCTAGON}" fill="none" stroke="currentColor" stroke-width="2.400" stroke-dasharray="4.500 2.600"/><text x="12" y="17" text-anchor="middle" font-size="14" font-weight="800" fill="currentColor" font-family="Inter">?</text>`),
  net: svg('<g fill="currentColor"><circle cx="12" cy="5" r="4"/><circle cx="4.500" cy="18.500" r="4"/><circle cx="19.500" cy="18.500" r="4"/></g><path d="M12 5L4.500 18.500h15z" fill="none" stroke="currentColor" stroke-width="2"/>'),
  split: svg('<g fill="currentColor"><circle cx="12" cy="5" r="4"/><circle cx="4.500" cy="18.500" r="4"/><circle cx="19.500" cy="18.500" r="4"/></g><path d="M9 10l-3 5" stroke="currentColor" stroke-width="2"/>'),
};
icons.done = icons.ok;
icons.rewind = svg('<path d="M1 1h22v22H1z" fill="currentColor"/><path d="M12 6v12L4.500 12zM20 6v12l-7.500-6z" fill="var(--surface)"/>');

export const legendIcons = {
  kept: '<svg viewBox="0 0 34 26"><path d="M0 13h34" stroke="var(--kept)" stroke-width="3"/></svg>',
  critical: '<svg viewBox="0 0 34 26"><path d="M0 10.500h34M0 15.500h34" stroke="var(--critical)" stroke-width="2.400"/></svg>',
  removed: '<svg viewBox="0 0 34 26"><path d="M0 13h34" stroke="var(--removed)" stroke-width="2" stroke-dasharray="2 6"/><path d="M12 8l10 10M22 8L12 18" stroke="var(--removed)" stroke-width="2.500"/></svg>',
  unverified: '<svg viewBox="0 0 34 26"><path d="M0 13h34" stroke="var(--red-text)" stroke-width="3" stroke-dasharray="8 5"/></svg>',
  open: '<svg viewBox="0 0 34 26"><circle cx="17" cy="13" r="8.500" fill="none" stroke="var(--ink)" stroke-width="2.600"/></svg>',
  seen: '<svg viewBox="0 0 34 26"><circle cx="17" cy="13" r="8.500" fill="none" stroke="var(--ink)" stroke-width="2.600"/><circle cx="17" cy="13" r="3" fill="var(--ink)"/></svg>',
  tracked: '<svg viewBox="0 0 34 26"><circle cx="17" cy="13" r="7.500" fill="none" stroke="var(--ink)" stroke-width="2.600"/><circle cx="17" cy="13" r="2.600" fill="var(--ink)"/><path d="M17 1v7M17 18v7M5 13h7M22 13h7" stroke="var(--ink)" stroke-width="2.600"/></svg>',
  done: '<svg viewBox="0 0 34 26"><circle cx="17" cy="13" r="8.500" fill="none" stroke="var(--done)" stroke-width="1.800"/><path d="M13 13l3 3 5-6" fill="none" stroke="var(--done)" stroke-width="2"/></svg>',
  fence: '<svg viewBox="0 0 34 26"><path d="M0 13h34" stroke="var(--ink3)" stroke-width="1.600" stroke-dasharray="2 5"/></svg>',
  target: '<svg viewBox="0 0 34 26"><circle cx="17" cy="13" r="8.500" fill="none" stroke="var(--ink)" stroke-width="2.600"/><circle cx="17" cy="13" r="3" fill="var(--ink)"/></svg>',
  disarmed: '<svg viewBox="0 0 34 26"><circle cx="17" cy="13" r="8.500" fill="none" stroke="var(--blue)" stroke-width="3.200"/></svg>',
  attention: '<svg viewBox="0 0 34 26"><path d="M17 2l11 11-11 11L6 13z" fill="var(--amber)"/></svg>',
};
