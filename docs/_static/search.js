// Ranks the sections of these pages, in sections.js, by the words of a query, and shows excerpts. It sends no request.
"use strict";

const COMMON = new Set(("a an and are be by can do does for from have how i if in is it its many much my of on one or our should "
  + "that the there this to was we what when where which who why will with you your mean means").split(" "));
const MOST = 30, LENGTH = 220;

// The stem of a word: without the ending of a plural, of a participle or of an -ing form.
function stem(word) {
  return word.length > 3 ? word.replace(/(?<=[^s])s$/, "").replace(/(?<=\w{3})(ing|ed)$/, "").replace(/(?<=\w{3})e$/, "") : word;
}

function words(text) {
  return text.toLowerCase().split(/[^\p{L}\p{N}_.-]+/u).flatMap((word) => word.split(/[_.-]+/)).filter(Boolean).map(stem);
}

const sections = SECTIONS.entries.map(([page, anchor, title, text]) => {
  const counts = new Map();
  for (const word of words(text)) counts.set(word, (counts.get(word) ?? 0) + 1);
  return { page, anchor, title, text, counts, titled: new Set(words(title)), length: words(text).length };
});
const usual = sections.reduce((sum, { length }) => sum + length, 0) / sections.length;

// How often a word, or else a word that begins with it, occurs.
function times(word, counts) {
  if (counts.has(word)) return counts.get(word);
  if (word.length < 4) return 0;
  for (const [each, count] of counts) if (each.startsWith(word)) return 0.5 * count;
  return 0;
}

const inTitle = (word, titled) => (titled.has(word) ? 1 : word.length > 3 && [...titled].some((each) => each.startsWith(word)) ? 0.5 : 0);

const same = (asked, titled) => asked.length === titled.size && asked.every((word) => titled.has(word));

// Sections by their score: BM25 of the text, the words of the title, and a share for words that are missing.
function ranked(query) {
  const every = [...new Set(words(query))], asked = every.filter((word) => !COMMON.has(word));
  const terms = asked.length ? asked : every;
  const rarity = terms.map((word) => {
    const holding = sections.filter(({ counts, titled }) => times(word, counts) || inTitle(word, titled)).length;
    return Math.log(1 + (sections.length - holding + 0.5) / (holding + 0.5));
  });
  return sections.map((section) => {
    let score = 0, met = 0;
    terms.forEach((word, at) => {
      const count = times(word, section.counts), title = inTitle(word, section.titled);
      score += rarity[at] * ((2.2 * count) / (count + 1.2 * (0.25 + (0.75 * section.length) / usual)) + 2.5 * title);
      if (count || title) met += rarity[at];
    });
    const share = met / (rarity.reduce((sum, each) => sum + each, 0) || 1);
    // A question that users ask is answered in short on a page of its own. A title may be the query itself.
    const weight = (section.page === SECTIONS.questions ? 1.6 : 1) * (same(every, section.titled) ? 2 : 1);
    return { ...section, score: score * share ** 2 * weight, terms };
  }).filter(({ score }) => score > 0).sort((a, b) => b.score - a.score).slice(0, MOST);
}

// The part of a text in which most of the words occur, as pieces [text, whether it is a word of the query].
function excerpt({ text, terms }) {
  const pieces = [...text.matchAll(/[\p{L}\p{N}]+/gu)].map((one) => ({ at: one.index, end: one.index + one[0].length, hit: terms.some((word) => stem(one[0].toLowerCase()).startsWith(word)) }));
  const hits = pieces.filter(({ hit }) => hit);
  let best = 0, most = 0;
  for (const { at } of hits) {
    const count = hits.filter((one) => one.at >= at && one.end <= at + LENGTH).length;
    if (count > most) [best, most] = [at, count];
  }
  const wanted = text.length > LENGTH ? Math.max(0, Math.min(best - 40, text.length - LENGTH)) : 0;
  const from = wanted && text.indexOf(" ", wanted) + 1, to = from + LENGTH < text.length ? text.lastIndexOf(" ", from + LENGTH) : text.length;
  const found = [[from ? "… " : "", false]];
  let at = from;
  for (const hit of hits.filter((one) => one.at >= from && one.end <= to)) {
    found.push([text.slice(at, hit.at), false], [text.slice(hit.at, hit.end), true]);
    at = hit.end;
  }
  return [...found, [text.slice(at, to) + (to < text.length ? " …" : ""), false]];
}

function show(query) {
  const list = document.getElementById("found"), results = ranked(query);
  document.getElementById("query").value = query;
  document.getElementById("count").textContent = results.length ? `Results for "${query}", best first:` : `Nothing was found for "${query}".`;
  list.replaceChildren(...results.map((one) => {
    const item = document.createElement("li"), link = item.appendChild(document.createElement("a"));
    link.href = `${one.page}.html#${one.anchor}`;
    const page = SECTIONS.pages[one.page];
    link.textContent = one.title && one.title !== page ? `${page}: ${one.title}` : page;
    const line = item.appendChild(document.createElement("p"));
    for (const [text, isHit] of excerpt(one)) {
      const part = isHit ? line.appendChild(document.createElement("mark")) : line;
      part.append(text);
    }
    return item;
  }));
}

const query = new URLSearchParams(location.search).get("q") ?? "";
if (query.trim()) show(query);
