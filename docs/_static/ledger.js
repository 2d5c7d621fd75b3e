// The ledger: filter by paper, class and words; sort by a column.
document.addEventListener("DOMContentLoaded", () => {
  const table = document.querySelector("table.ledger");
  const body = table.tBodies[0], rows = [...body.rows];
  const [paper, kind, words] = ["paper", "kind", "words"].map(id => document.getElementById(id));
  const shown = document.getElementById("shown");
  const filter = () => {
    const asked = words.value.toLowerCase().split(/\s+/).filter(Boolean);
    let count = 0;
    for (const row of rows) {
      const text = row.textContent.toLowerCase();
      row.hidden = !((!paper.value || row.dataset.paper === paper.value) &&
        (!kind.value || row.dataset.kind === kind.value) && asked.every(word => text.includes(word)));
      count += !row.hidden;
    }
    shown.textContent = `${count} of ${rows.length} claims`;
  };
  const value = (row, k) => row.cells[k].dataset.value ?? row.cells[k].textContent;
  const number = text => text.trim() ? Number(text) : NaN;
  const compare = (x, y) => isNaN(number(x)) - isNaN(number(y)) || number(x) - number(y) ||
    x.localeCompare(y, "en", { numeric: true });
  const sort = (head, k) => {
    const down = head.ariaSort === "ascending";
    for (const other of table.tHead.rows[0].cells) other.ariaSort = "none";
    head.ariaSort = down ? "descending" : "ascending";
    const order = (a, b) => compare(value(a, k), value(b, k)) || a.dataset.order - b.dataset.order;
    body.append(...rows.sort((a, b) => down ? order(b, a) : order(a, b)));
  };
  for (const field of [paper, kind, words]) field.addEventListener("input", filter);
  [...table.tHead.rows[0].cells].forEach((head, k) => head.querySelector("button").addEventListener("click", () => sort(head, k)));
  filter();
});
