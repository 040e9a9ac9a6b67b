% Times the chain of `chain.py` as it is written in Octave: one loop over the samples for all plays together,
% filters for the rest. Prints `program,samples,seconds`, the quickest of three runs.
%
%     octave-cli --quiet benchmarks/speed/chain.m
1;

function y = chain(drive_v, thresholds, weights_um, shares, decays, b, a)
  x = drive_v / 70;
  plays = zeros(1, 10);
  out = zeros(size(x));
  for k = 1:numel(x)
    plays = min(max(plays, x(k) - thresholds), x(k) + thresholds);
    out(k) = plays * weights_um';
  end
  slow = zeros(size(x));
  for i = 1:numel(shares)
    slow += shares(i) * filter([0, 1 - decays(i)], [1, -decays(i)], out);
  end
  y = filter(b, a, out + slow);
end

rate_hz = 20000;
w = 5000; d = 0.3;
decay = exp(-d * w / rate_hz);
p = w * sqrt(1 - d^2);
c = cos(p / rate_hz); s = sin(p / rate_hz);
b = [0, 1 - decay * (c + d * w / p * s), decay^2 + decay * (d * w / p * s - c)];
a = [1, -2 * decay * c, decay^2];
samples = 100000;
triangle = @(period) 1 - abs(2 * mod(0:samples - 1, period) / period - 1);
drive_v = 70 * (0.01 + 0.6 * triangle(1181) + 0.38 * triangle(281));
quickest_s = Inf;
for run = 1:3
  begin = tic;
  y = chain(drive_v, 0.05 * (0:9), [8.4, 0.23 * ones(1, 9)], [0.02, 0.02, 0.02], exp(-1 / rate_hz ./ [0.1, 1, 10]), b, a);
  quickest_s = min(quickest_s, toc(begin));
end
% The mean of what `chain.py` computes.
assert(mean(y), 5.444759850732253, 1e-9);
printf("Octave,%d,%.6f\n", samples, quickest_s);
