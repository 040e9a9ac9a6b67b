// Questions and answers as bytes: the length of a JSON text, the text, what stands behind it. Numbers are
// little-endian.
"use strict";

/** What a question ends with when somebody took it back. */
class Cancelled extends Error {}

/** A question and the bytes of its files. */
function questionBytes(question, files) {
  const text = new TextEncoder().encode(JSON.stringify(question));
  const bytes = new Uint8Array(8 + text.length + files.reduce((sum, file) => sum + file.length, 0));
  new DataView(bytes.buffer).setBigUint64(0, BigInt(text.length), true);
  bytes.set(text, 8);
  let at = 8 + text.length;
  for (const file of files) {
    bytes.set(file, at);
    at += file.length;
  }
  return bytes;
}

/** An answer: JSON, and columns of 64-bit floats over the same bytes. */
function answerOf(buffer) {
  const jsonLength = Number(new DataView(buffer).getBigUint64(0, true));
  const json = JSON.parse(new TextDecoder().decode(new Uint8Array(buffer, 8, jsonLength)));
  let from = 8 + jsonLength;
  const columns = json.columns.map((count) => {
    const column = new Float64Array(buffer, from, count);
    from += 8 * count;
    return column;
  });
  return { json, columns };
}

