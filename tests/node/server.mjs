// A gem_server on free ports of the loopback interface.
import { spawn } from 'node:child_process';
import path from 'node:path';

import { ROOT } from './protocol.mjs';

const BIN = process.env.GEM_BIN ?? path.join(ROOT, 'build/release/bin');

export async function startServer() {
  const child = spawn(
    path.join(BIN, 'gem_server'),
    ['--listen', '127.0.0.1:0', '--metrics_listen', '127.0.0.1:0', '--log_level', 'warn'],
    { stdio: ['ignore', 'pipe', 'inherit'] },
  );
  const ended = new Promise((resolve) => child.once('exit', resolve));
  let text = '';
  const address = await new Promise((resolve, reject) => {
    child.once('error', reject);
    child.once('exit', () => reject(new Error(`gem_server did not get ready: ${text}`)));
    child.stdout.on('data', (data) => {
      text += data;
      const ready = text.match(/gem_server ready grpc=(\S+)/);
      if (ready) resolve(ready[1]);
    });
  });
  return {
    address,
    /// Its exit code.
    stop() {
      child.kill('SIGTERM');
      return ended;
    },
  };
}
