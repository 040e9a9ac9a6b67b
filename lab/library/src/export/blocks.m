% block linear
function [y, rest_out] = h_linear(x, rest, phi, start_, end_, out, before, through, at_rest, offset)
  % y = out s + before x(k-1) + through x(k); s = phi s + start x(k-1) + end x(k); x and y count from offset.
  last = rest - offset;
  s = at_rest * last;
  rest_out = out * s + (before + through) * last + offset;
  y = zeros(size(x));
  for k = 1:numel(x)
    now = x(k) - offset;
    y(k) = out * s + before * last + through * now + offset;
    s = phi * s + start_ * last + end_ * now;
    last = now;
  end
end
% block proportional
function [y, rest_out] = h_proportional(x, rest, gain, offset)
  y = gain * (x - offset);
  rest_out = gain * (rest - offset);
end
% block clamp
function [y, rest_out] = h_clamp(x, rest, lower, upper)
  y = max(min(x, upper), lower);
  rest_out = max(min(rest, upper), lower);
end
% block slope
function [y, rest_out] = h_slope(x, rest, most, gives_mean)
  stands = rest;
  y = zeros(size(x));
  for k = 1:numel(x)
    start_ = stands;
    away = x(k) - start_;
    arrives = abs(away) <= most;
    if arrives
      stands = x(k);
    else
      stands = start_ + most * sign(away);
    end
    if ~gives_mean
      y(k) = stands;
    elseif arrives
      share = 1;
      if most > 0
        share = abs(away) / most;
      end
      y(k) = x(k) - away * 0.5 * share;
    else
      y(k) = 0.5 * (start_ + stands);
    end
  end
  rest_out = rest;
end
% block delay
function [y, rest_out] = h_delay(x, rest, whole, late_share)
  line = [rest * ones(whole + 1, 1); x];
  n = numel(x);
  y = late_share * line(1:n) + (1 - late_share) * line(2:n+1);
  rest_out = rest;
end
% block loops
function [out, rest_out] = h_loops(x, rest, g, r, plays, rate, lower, span)
  % One-sided Preisach hysteresis: surfaces G and R in powers of (x - lower) / span, and play operators beside them.
  m = struct('high', zeros(1, 128), 'low', zeros(1, 128), 'n', 0, 'open', NaN, 'input', 0, 'stands', zeros(size(plays, 1), 1));
  [y, ~, m] = h_follow(m, (rest - lower) / span, g, r, plays);
  rest_out = y;
  last = rest;
  out = zeros(size(x));
  unchanged = 1;
  if ~isempty(rate)
    unchanged = rate(5);
  end
  for k = 1:numel(x)
    moves = x(k) ~= last;
    if isempty(rate)
      if moves
        [y, ~, m] = h_follow(m, (x(k) - lower) / span, g, r, plays);
      end
    else
      if ~moves
        unchanged = unchanged + 1;
      end
      if moves || unchanged >= rate(5)
        intervals = 1;
        if unchanged + 1 >= rate(5)
          intervals = rate(5);
        end
        if moves
          unchanged = 0;
        end
        v = abs(x(k) - last) / (rate(4) * intervals) / 1e4;
        [still, first, m] = h_follow(m, (x(k) - lower) / span, g, r, plays);
        y = first * (1 + rate(3) * v) - (first - still) * (1 + v * (rate(1) + v * rate(2)));
      end
    end
    last = x(k);
    out(k) = y;
  end
end

function [y, first, m] = h_follow(m, v, g, r, plays)
  if v > m.input
    if ~isnan(m.open)
      if m.n < 128
        m.n = m.n + 1;
        m.high(m.n) = m.open;
        m.low(m.n) = m.input;
      end
      m.open = NaN;
    end
    while m.n > 0 && v >= m.high(m.n)
      m.n = m.n - 1;
    end
  elseif v < m.input
    if isnan(m.open)
      m.open = m.input;
    end
    while m.n > 0 && v <= m.low(m.n)
      m.open = m.high(m.n);
      m.n = m.n - 1;
    end
  end
  m.input = v;
  if m.n > 0
    top = m.high(1);
  elseif ~isnan(m.open)
    top = m.open;
  else
    top = v;
  end
  first = h_loss(g, top, 0) + h_polynomial(r, top);
  y = first;
  for i = 1:m.n
    inner = v;
    if i < m.n
      inner = m.high(i + 1);
    elseif ~isnan(m.open)
      inner = m.open;
    end
    y = y - h_loss(g, m.high(i), m.low(i)) + h_loss(g, inner, m.low(i));
  end
  if ~isnan(m.open)
    y = y - h_loss(g, m.open, v);
  end
  for i = 1:size(plays, 1)
    m.stands(i) = min(max(m.stands(i), v - plays(i, 1)), v + plays(i, 1));
    y = y + plays(i, 2) * m.stands(i);
    first = first + plays(i, 2) * max(top - plays(i, 1), 0);
  end
end

function y = h_polynomial(c, v)
  y = 0;
  for i = numel(c):-1:1
    y = y * v + c(i);
  end
end

function y = h_loss(g, high, low)
  y = 0;
  for i = size(g, 1):-1:1
    y = y * high + h_polynomial(g(i, :), low);
  end
end
% block plays
function [y, rest_out] = h_plays(x, rest, plays, zones, lower, span)
  stands = zeros(size(plays, 1), 1);
  y = zeros(size(x));
  for k = 0:numel(x)
    value = rest;
    if k > 0
      value = x(k);
    end
    v = (value - lower) / span;
    stands = min(max(stands, v - plays(:, 1)), v + plays(:, 1));
    total = sum(plays(:, 2) .* stands);
    now = total;
    if ~isempty(zones)
      now = total + sum(zones(:, 2) .* max(total - zones(:, 1), 0));
    end
    if k > 0
      y(k) = now;
    else
      rest_out = now;
    end
  end
end
% block slip
function [y, rest_out] = h_slip(x, rest, gain, elements, lower, span)
  stretch = zeros(size(elements, 1), 1);
  last = 0;
  y = zeros(size(x));
  for k = 0:numel(x)
    value = rest;
    if k > 0
      value = x(k);
    end
    v = (value - lower) / span;
    stretch = min(max(stretch + v - last, -elements(:, 1)), elements(:, 1));
    last = v;
    now = gain * v - sum(elements(:, 2) .* stretch);
    if k > 0
      y(k) = now;
    else
      rest_out = now;
    end
  end
end
% block bouc_wen
function [y, rest_out] = h_bouc_wen(x, rest, gain, alpha, beta_, gamma_, lower, span)
  h = 0;
  last = 0;
  y = zeros(size(x));
  for k = 0:numel(x)
    value = rest;
    if k > 0
      value = x(k);
    end
    v = (value - lower) / span;
    pieces = min(max(ceil(abs(v - last) * 200), 1), 400);
    piece = (v - last) / pieces;
    for i = 1:pieces
      rate = beta_ * abs(piece) + gamma_ * piece * h_sign(h);
      middle = h + 0.5 * (alpha * piece - rate * h);
      rate = beta_ * abs(piece) + gamma_ * piece * h_sign(middle);
      h = h + alpha * piece - rate * middle;
    end
    last = v;
    if k > 0
      y(k) = gain * v - h;
    else
      rest_out = gain * v - h;
    end
  end
end

function s = h_sign(v)
  s = 1;
  if v < 0
    s = -1;
  end
end
% block duhem
function [y, rest_out] = h_duhem(x, rest, approach, slope, elastic, lower, span)
  now = 0;
  last = 0;
  y = zeros(size(x));
  for k = 0:numel(x)
    value = rest;
    if k > 0
      value = x(k);
    end
    v = (value - lower) / span;
    change = v - last;
    if change ~= 0 && approach > 1e-9
      forcing = (elastic - slope) * sign(change) / approach;
      now = slope * v + forcing + (now - slope * last - forcing) * exp(-approach * abs(change));
    else
      now = now + elastic * change;
    end
    last = v;
    if k > 0
      y(k) = now;
    else
      rest_out = now;
    end
  end
end
% block gap
function [y, rest_out] = h_gap(x, rest, half)
  stands = rest;
  y = zeros(size(x));
  for k = 1:numel(x)
    stands = min(max(stands, x(k) - half), x(k) + half);
    y(k) = stands;
  end
  rest_out = rest;
end
% block drift
function [y, rest_out] = h_drift(x, rest, rate, slowing)
  n = (1:numel(x))';
  if slowing == 0
    amount = n;
  else
    amount = -expm1(-slowing * n) / slowing;
    straight = abs(slowing * n) < 1e-9;
    amount(straight) = n(straight);
  end
  y = x + rate * amount;
  rest_out = rest;
end
% block lines
function [y, rest_out] = h_lines(x, rest, lines)
  n = (1:numel(x))';
  y = x;
  rest_out = rest;
  for i = 1:size(lines, 1)
    y = y + lines(i, 3) * cos(lines(i, 1) * n) + lines(i, 2) * sin(lines(i, 1) * n);
    rest_out = rest_out + lines(i, 3);
  end
end
% block bend
function [y, rest_out] = h_bend(x, rest, quadratic, cubic)
  y = x .* (1 + x .* (quadratic + x * cubic));
  rest_out = rest * (1 + rest * (quadratic + rest * cubic));
end
% block force
function [y, rest_out] = h_force(x, rest, force, substeps, compliance)
  f = reshape(repmat(force(:)', substeps, 1), [], 1);
  y = x + compliance * f(1:numel(x));
  rest_out = rest + compliance * force(1);
end
