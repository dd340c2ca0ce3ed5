// In the browser: compiles every program with the browser's own compiler, and
// runs every kernel over its golden vectors.

/** Words of 32 bits from hexadecimal text. */
const words = (text) =>
  Uint32Array.from(text ? text.split(" ") : [], (word) => parseInt(word, 16));

async function newDevice() {
  const adapter = await navigator.gpu?.requestAdapter();
  if (!adapter) throw new Error("this browser gives no WebGPU adapter");
  const subgroups = adapter.features.has("subgroups");
  const device = await adapter.requestDevice({
    requiredFeatures: subgroups ? ["subgroups"] : [],
  });
  const { vendor, architecture, description } = adapter.info;
  const name = [vendor, architecture, description].filter(Boolean).join(", ");
  return { device, subgroups, name };
}

/** The module, or an error with the compiler's message and its line. */
async function compile(device, source) {
  device.pushErrorScope("validation");
  const module = device.createShaderModule({ code: source });
  const { messages } = await module.getCompilationInfo();
  const refused = await device.popErrorScope();
  const error = messages.find((m) => m.type === "error");
  if (error) {
    const line = source.split("\n")[error.lineNum - 1] ?? "";
    throw new Error(`line ${error.lineNum}: ${error.message}: ${line.trim()}`);
  }
  if (refused) throw new Error(refused.message);
  return module;
}

/** The names of a program's entry points. */
const entries = (source) =>
  [...source.matchAll(/^@compute[^{;]*?fn (\w+)/gm)].map((found) => found[1]);

/** Compiles a program, and a pipeline for each entry point that it has. */
export async function checkProgram({ device }, { source }) {
  const module = await compile(device, source);
  for (const entryPoint of entries(source)) {
    const compute = { module, entryPoint };
    await device.createComputePipelineAsync({ layout: "auto", compute });
  }
}

const WORKGROUP = 64;

/** Runs the shader over an array of argument lists and reads the results. */
async function run(device, shader, input, fixture, count, wordsOut) {
  const module = await compile(device, shader);
  const pipeline = await device.createComputePipelineAsync({
    layout: "auto",
    compute: { module, entryPoint: "raytwin_main" },
  });
  const { STORAGE, COPY_SRC, COPY_DST, MAP_READ } = GPUBufferUsage;
  const filled = (data, usage) => {
    const buffer = device.createBuffer({
      size: Math.max(data.byteLength, 16),
      usage,
      mappedAtCreation: true,
    });
    new Uint32Array(buffer.getMappedRange()).set(data);
    buffer.unmap();
    return buffer;
  };
  // Poisoned, so that an element that is not written is seen.
  const poison = new Uint32Array(count * wordsOut).fill(0xdeadbeef);
  const size = poison.byteLength;
  const buffers = [
    filled(input, STORAGE),
    // Its length says how many elements there are.
    device.createBuffer({ size, usage: STORAGE | COPY_SRC | COPY_DST }),
    filled(fixture, STORAGE),
  ];
  device.queue.writeBuffer(buffers[1], 0, poison);
  const bound = device.createBindGroup({
    layout: pipeline.getBindGroupLayout(0),
    entries: buffers.map((buffer, binding) => ({ binding, resource: { buffer } })),
  });
  const readback = device.createBuffer({ size, usage: COPY_DST | MAP_READ });
  const encoder = device.createCommandEncoder();
  const pass = encoder.beginComputePass();
  pass.setPipeline(pipeline);
  pass.setBindGroup(0, bound);
  pass.dispatchWorkgroups(Math.ceil(count / WORKGROUP));
  pass.end();
  encoder.copyBufferToBuffer(buffers[1], 0, readback, 0, size);
  device.queue.submit([encoder.finish()]);
  await readback.mapAsync(GPUMapMode.READ);
  const result = new Uint32Array(readback.getMappedRange().slice(0));
  readback.unmap();
  for (const buffer of [...buffers, readback]) buffer.destroy();
  return result;
}

const float = (word) => new Float32Array(Uint32Array.of(word).buffer)[0];

/** Runs a kernel; how many numbers were compared. */
export async function checkKernel({ device }, { shader, golden }) {
  const { cases, output } = golden;
  const input = words(cases.map((c) => c.in).filter(Boolean).join(" "));
  const fixture = words(golden.fixture?.words ?? "");
  device.pushErrorScope("validation");
  const result = await run(device, shader, input, fixture, cases.length, output.length);
  const refused = await device.popErrorScope();
  if (refused) throw new Error(refused.message);
  let compared = 0;
  for (const [i, c] of cases.entries()) {
    if (c.undecided) continue;
    for (const [lane, expected] of words(c.out).entries()) {
      const [name, type] = output[lane];
      const found = result[i * output.length + lane];
      const right =
        type === "u32"
          ? found === expected
          : Math.abs(float(found) - float(expected)) <= c.allowed[lane];
      if (!right) {
        const show = (word) => (type === "u32" ? word : float(word));
        throw new Error(
          `${name || "the result"} is ${show(found)}, not ${show(expected)} ` +
            `within ${c.allowed[lane]}, of ${c.in}`,
        );
      }
      compared += 1;
    }
  }
  return compared;
}

/** All of it. Progress goes to the console. */
globalThis.check = async () => {
  const read = async (name) => (await fetch(`data/${name}`)).json();
  const names = ["programs.json", "npm.json", "kernels.json"];
  const [ours, linked, kernels] = await Promise.all(names.map(read));
  const programs = [...ours, ...linked];
  const gpu = await newDevice();
  const report = { adapter: gpu.name, passed: 0, compared: 0, failures: [], skipped: [] };
  const attempt = async (name, action) => {
    try {
      const compared = await action();
      report.passed += 1;
      report.compared += compared ?? 0;
    } catch (error) {
      report.failures.push(`${name}: ${error.message}`);
    }
  };
  console.log(`${programs.length} programs`);
  for (const program of programs) {
    if (program.subgroups && !gpu.subgroups) report.skipped.push(`${program.name}: no subgroups`);
    else await attempt(`compiles ${program.name}`, () => checkProgram(gpu, program));
  }
  console.log(`${kernels.length} kernels`);
  for (const kernel of kernels) {
    const name = `${kernel.golden.module}::${kernel.golden.function}`;
    await attempt(`runs ${name}`, () => checkKernel(gpu, kernel));
  }
  return report;
};
