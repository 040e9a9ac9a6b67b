// The library in a worker of its own, so that the page stays alive while a search goes on. Ended to cancel.
"use strict";

let library = null;

function textAt(address, length) {
  return new TextDecoder().decode(new Uint8Array(library.memory.buffer, address, length));
}

async function start(bytes) {
  const module = await WebAssembly.compile(bytes);
  const imports = {};
  // A reader of archives could ask for random numbers, to encrypt; nobody encrypts here.
  for (const { module: from, name } of WebAssembly.Module.imports(module)) {
    (imports[from] ??= {})[name] = () => {
      throw new Error(`${name} is not there`);
    };
  }
  imports.page.progress = (address, length) => postMessage({ progress: JSON.parse(textAt(address, length)) });
  library = (await WebAssembly.instantiate(module, imports)).exports;
}

/** Question and files in linear memory; the answer as JSON and columns of 64-bit floats. */
function ask(question, files) {
  const text = new TextEncoder().encode(JSON.stringify(question));
  const length = 8 + text.length + files.reduce((sum, file) => sum + file.length, 0);
  const room = library.hysteron_reserve(length);
  new DataView(library.memory.buffer).setBigUint64(room, BigInt(text.length), true);
  const target = new Uint8Array(library.memory.buffer, room, length);
  target.set(text, 8);
  let at = 8 + text.length;
  for (const file of files) {
    target.set(file, at);
    at += file.length;
  }
  const size = library.hysteron_ask();
  const answer = library.memory.buffer.slice(library.hysteron_answer(), library.hysteron_answer() + size);
  const jsonLength = Number(new DataView(answer).getBigUint64(0, true));
  const json = JSON.parse(new TextDecoder().decode(new Uint8Array(answer, 8, jsonLength)));
  let from = 8 + jsonLength;
  const columns = json.columns.map((count) => {
    const column = new Float64Array(answer, from, count);
    from += 8 * count;
    return column;
  });
  return { json, columns, buffer: answer };
}

let ready = null;

onmessage = async ({ data }) => {
  if (data.module) ready = start(data.module);
  try {
    // Questions may come before the library stands.
    await ready;
    if (data.module) return;
    const { json, columns, buffer } = ask(data.question, data.files);
    postMessage({ id: data.id, json, columns }, [buffer]);
  } catch (error) {
    if (library) postMessage({ id: data.id, broken: String(error.message) });
    else postMessage({ broken: `This browser cannot run the library: ${error.message}` });
  }
};
