// A WebGPU device, and compute shaders over plain arrays of words.

let ready;

/** The device, or null where there is no WebGPU. One for the whole page. */
export function device() {
  ready ??= (async () => {
    const adapter = await globalThis.navigator?.gpu?.requestAdapter();
    return adapter ? adapter.requestDevice() : null;
  })().catch(() => null);
  return ready;
}

/** Words of 32 bits from hexadecimal text. */
export const words = (text) =>
  Uint32Array.from(text ? text.split(" ") : [], (word) => parseInt(word, 16));

const bits = new Uint32Array(1);
const number = new Float32Array(bits.buffer);
/** A word's number, and a number's word. */
export const toFloat = (word) => ((bits[0] = word), number[0]);
export const toWord = (value) => ((number[0] = value), bits[0]);

/** A storage buffer; `source` is an array or a number of bytes. */
export function storage(gpu, source, usage = 0) {
  const size = Math.max(typeof source === "number" ? source : source.byteLength, 16);
  const { STORAGE, COPY_SRC, COPY_DST } = GPUBufferUsage;
  const buffer = gpu.createBuffer({ size, usage: STORAGE | COPY_SRC | COPY_DST | usage });
  if (typeof source !== "number") gpu.queue.writeBuffer(buffer, 0, source);
  return buffer;
}

/** The words of a buffer. */
export async function read(gpu, buffer, size = buffer.size) {
  const { COPY_DST, MAP_READ } = GPUBufferUsage;
  const copy = gpu.createBuffer({ size, usage: COPY_DST | MAP_READ });
  const encoder = gpu.createCommandEncoder();
  encoder.copyBufferToBuffer(buffer, 0, copy, 0, size);
  gpu.queue.submit([encoder.finish()]);
  await copy.mapAsync(GPUMapMode.READ);
  const result = copy.getMappedRange().slice(0);
  copy.destroy();
  return result;
}

/** A pipeline of `source`; errors carry the compiler's message. */
export async function pipeline(gpu, source, entryPoint) {
  const module = gpu.createShaderModule({ code: source });
  const { messages } = await module.getCompilationInfo();
  const error = messages.find((m) => m.type === "error");
  if (error) throw new Error(`line ${error.lineNum}: ${error.message}`);
  return gpu.createComputePipelineAsync({ layout: "auto", compute: { module, entryPoint } });
}

/** What a pipeline reads and writes: `{ binding: buffer }` of one group. */
export function bind(gpu, made, group, buffers) {
  const entries = Object.entries(buffers).map(([binding, buffer]) => ({
    binding: Number(binding),
    resource: { buffer },
  }));
  return gpu.createBindGroup({ layout: made.getBindGroupLayout(group), entries });
}

/** Dispatches: `[pipeline, { group: bindGroup }, x, y]` each, in order. */
export function dispatch(gpu, ...passes) {
  const encoder = gpu.createCommandEncoder();
  for (const [made, groups, x, y = 1] of passes) {
    const pass = encoder.beginComputePass();
    pass.setPipeline(made);
    for (const [group, bound] of Object.entries(groups)) pass.setBindGroup(Number(group), bound);
    pass.dispatchWorkgroups(x, y);
    pass.end();
  }
  gpu.queue.submit([encoder.finish()]);
}

/** A shader of the demonstrations: `main` writes `result`, reads `settings`. */
export async function numbers(gpu, library, main, count) {
  const source = `${library}
@group(0) @binding(0) var<storage, read_write> result: array<vec4f>;
@group(0) @binding(1) var<storage, read> settings: array<vec4f>;
${main}`;
  const made = await pipeline(gpu, source, "main");
  const result = storage(gpu, 16 * count);
  const settings = storage(gpu, 256);
  const bound = bind(gpu, made, 0, { 0: result, 1: settings });
  return async (values) => {
    gpu.queue.writeBuffer(settings, 0, new Float32Array(values));
    dispatch(gpu, [made, { 0: bound }, Math.ceil(count / 64)]);
    return new Float32Array(await read(gpu, result));
  };
}
