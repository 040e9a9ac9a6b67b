// The library in a worker of its own, so that the page stays alive while a search goes on. Ended to cancel.

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

/** Question and files through linear memory. */
function ask(question, files) {
  const bytes = questionBytes(question, files);
  const room = library.hysteron_reserve(bytes.length);
  new Uint8Array(library.memory.buffer, room, bytes.length).set(bytes);
  const size = library.hysteron_ask();
  const at = library.hysteron_answer();
  const buffer = library.memory.buffer.slice(at, at + size);
  return { ...answerOf(buffer), buffer };
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
