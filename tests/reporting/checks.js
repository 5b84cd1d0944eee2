// What a reader would see on a report, as lists of faults; evaluated in the page.

function overflowing() {
  const found = [];
  for (const e of document.querySelectorAll('body *')) {
    if (e.closest('svg')) continue;
    const style = getComputedStyle(e), name = e.tagName + '.' + e.className;
    if (e.closest('details:not([open])') && e.tagName !== 'SUMMARY') continue;
    if (e.classList.contains('scroll')) continue;
    if (style.overflowX !== 'visible' && e.scrollWidth > e.clientWidth + 1)
      found.push('clips ' + name);
    const box = e.getBoundingClientRect();
    if (!e.closest('.scroll') && box.width > 0 && (box.right > innerWidth + 1 || box.left < -1))
      found.push('beyond ' + name + ' ' + box.right);
  }
  return found;
}

function cutInFigures() {
  const found = [];
  for (const d of document.querySelectorAll('details')) d.open = true;
  for (const svg of document.querySelectorAll('figure svg')) {
    const frame = svg.getBoundingClientRect();
    const boxes = [];
    for (const text of svg.querySelectorAll('text')) {
      const b = text.getBoundingClientRect();
      if (!b.width) continue;
      const aside = b.left < frame.left - 1 || b.right > frame.right + 1;
      if (aside || b.top < frame.top - 1 || b.bottom > frame.bottom + 1)
        found.push(svg.closest('figure').id + ' cuts ' + text.textContent);
      boxes.push([b, text.textContent]);
    }
    for (let i = 0; i < boxes.length; i++) for (let j = 0; j < i; j++) {
      const [a, s] = boxes[i], [b, t] = boxes[j];
      const w = Math.min(a.right, b.right) - Math.max(a.left, b.left);
      const h = Math.min(a.bottom, b.bottom) - Math.max(a.top, b.top);
      if (w > 1 && h > 4) found.push(svg.closest('figure').id + ' covers ' + s + ' with ' + t);
    }
  }
  return found;
}

function stackedLetters() {
  const found = [], range = document.createRange();
  for (const d of document.querySelectorAll('details')) d.open = true;
  for (const cell of document.querySelectorAll('th, td')) {
    range.selectNodeContents(cell);
    const lines = new Set([...range.getClientRects()].map(box => Math.round(box.bottom / 8))).size;
    if (lines > 3 && cell.textContent.length / lines < 4) found.push(cell.textContent);
  }
  return found;
}

function cutTables() {
  return [...document.querySelectorAll('.scroll')]
  .filter(e => e.checkVisibility() && e.scrollWidth > e.clientWidth + 1)
  .map(e => e.getAttribute('aria-labelledby'));
}

function headings() {
  return [...document.querySelectorAll('h2, h3')].filter(e => e.checkVisibility()).map(e => e.textContent);
}

function colours() {
  const of = (e, p) => getComputedStyle(e)[p];
  return [of(document.body, 'backgroundColor'), of(document.body, 'color'),
          of(document.querySelector('figure svg text'), 'fill')];
}
