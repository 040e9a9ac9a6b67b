/* block linear */
static double h_linear_read(int n, const double *out, double before, double through, const double *s, double last, double now)
{
    double y = before * last + through * now;
    for (int i = 0; i < n; i++) y += out[i] * s[i];
    return y;
}

/* y = out s + before x[k-1] + through x[k]; s = phi s + start x[k-1] + end x[k]; x and y count from offset. */
static double h_linear(int n, const double *phi, const double *start, const double *end, const double *out, double before, double through,
                       double offset, double *s, double *last, double x)
{
    double now = x - offset, next[H_STATES_MAX];
    double y = h_linear_read(n, out, before, through, s, *last, now) + offset;
    for (int i = 0; i < n; i++) {
        next[i] = start[i] * *last + end[i] * now;
        for (int j = 0; j < n; j++) next[i] += phi[i * n + j] * s[j];
    }
    for (int i = 0; i < n; i++) s[i] = next[i];
    *last = now;
    return y;
}

static double h_linear_rest(int n, const double *out, double before, double through, const double *at_rest, double offset, double *s,
                            double *last, double x)
{
    *last = x - offset;
    for (int i = 0; i < n; i++) s[i] = at_rest[i] * *last;
    return h_linear_read(n, out, before, through, s, *last, *last) + offset;
}
/* block slope */
static double h_slope(double most, int gives_mean, double *stands, double x)
{
    double start = *stands, away = x - start;
    int arrives = fabs(away) <= most;
    *stands = arrives ? x : start + copysign(most, away);
    if (!gives_mean) return *stands;
    if (arrives) return x - away * 0.5 * (most > 0.0 ? fabs(away) / most : 1.0);
    return 0.5 * (start + *stands);
}
/* block delay */
static double h_delay(int whole, double late_share, double *line, int *at, double x)
{
    /* A ring of whole + 1 inputs; the oldest one stands at `at`. */
    double late = line[*at], early;
    line[*at] = x;
    *at = (*at + 1) % (whole + 1);
    early = line[*at];
    return late_share * late + (1.0 - late_share) * early;
}
/* block loops */
typedef struct {
    double high[H_PAIRS], low[H_PAIRS], open, input, last, y;
    int n, is_open, unchanged;
} h_memory;

static double h_polynomial(int n, const double *c, double v)
{
    double y = 0.0;
    while (n-- > 0) y = y * v + c[n];
    return y;
}

static double h_loss(int n, const double *g, double high, double low)
{
    double y = 0.0;
    for (int i = n - 1; i >= 0; i--) y = y * high + h_polynomial(n, g + i * n, low);
    return y;
}

/* One-sided Preisach hysteresis: surfaces G and R in powers of v, and play operators beside them. */
static double h_follow(int n, const double *g, int terms, const double *r, int plays, const double (*play)[2], h_memory *m, double *stands,
                       double v, double *first)
{
    double top, y;
    if (v > m->input) {
        if (m->is_open) {
            if (m->n < H_PAIRS) {
                m->high[m->n] = m->open;
                m->low[m->n++] = m->input;
            }
            m->is_open = 0;
        }
        while (m->n > 0 && v >= m->high[m->n - 1]) m->n--;
    } else if (v < m->input) {
        if (!m->is_open) {
            m->open = m->input;
            m->is_open = 1;
        }
        while (m->n > 0 && v <= m->low[m->n - 1]) m->open = m->high[--m->n];
    }
    m->input = v;
    top = m->n > 0 ? m->high[0] : m->is_open ? m->open : v;
    *first = h_loss(n, g, top, 0.0) + h_polynomial(terms, r, top);
    y = *first;
    for (int i = 0; i < m->n; i++) {
        double inner = i + 1 < m->n ? m->high[i + 1] : m->is_open ? m->open : v;
        y += h_loss(n, g, inner, m->low[i]) - h_loss(n, g, m->high[i], m->low[i]);
    }
    if (m->is_open) y -= h_loss(n, g, m->open, v);
    for (int i = 0; i < plays; i++) {
        stands[i] = fmin(fmax(stands[i], v - play[i][0]), v + play[i][0]);
        y += play[i][1] * stands[i];
        *first += play[i][1] * fmax(top - play[i][0], 0.0);
    }
    return y;
}

/* rate: loops linear, loops quadratic, curve linear, interval in s, intervals in a period; or none. */
static double h_loops(int n, const double *g, int terms, const double *r, int plays, const double (*play)[2], const double *rate,
                      double lower, double span, h_memory *m, double *stands, double x)
{
    double first;
    int moves = x != m->last;
    if (rate == 0) {
        if (moves) m->y = h_follow(n, g, terms, r, plays, play, m, stands, (x - lower) / span, &first);
    } else {
        int substeps = (int)rate[4];
        if (!moves) m->unchanged++;
        if (moves || m->unchanged >= substeps) {
            int intervals = m->unchanged + 1 >= substeps ? substeps : 1;
            double v, still;
            if (moves) m->unchanged = 0;
            v = fabs(x - m->last) / (rate[3] * intervals) / 1e4;
            still = h_follow(n, g, terms, r, plays, play, m, stands, (x - lower) / span, &first);
            m->y = first * (1.0 + rate[2] * v) - (first - still) * (1.0 + v * (rate[0] + v * rate[1]));
        }
    }
    m->last = x;
    return m->y;
}

static double h_loops_rest(int n, const double *g, int terms, const double *r, int plays, const double (*play)[2], const double *rate,
                           double lower, double span, h_memory *m, double *stands, double x)
{
    double first;
    m->n = m->is_open = 0;
    m->open = m->input = 0.0;
    for (int i = 0; i < plays; i++) stands[i] = 0.0;
    m->unchanged = rate ? (int)rate[4] : 1;
    m->last = x;
    return m->y = h_follow(n, g, terms, r, plays, play, m, stands, (x - lower) / span, &first);
}
/* block plays */
static double h_plays(int n, const double (*play)[2], int zones, const double (*zone)[2], double lower, double span, double *stands, double x)
{
    double v = (x - lower) / span, total = 0.0, y;
    for (int i = 0; i < n; i++) {
        stands[i] = fmin(fmax(stands[i], v - play[i][0]), v + play[i][0]);
        total += play[i][1] * stands[i];
    }
    y = total;
    for (int i = 0; i < zones; i++) y += zone[i][1] * fmax(total - zone[i][0], 0.0);
    return y;
}
/* block slip */
static double h_slip(double gain, int n, const double (*element)[2], double lower, double span, double *stretch, double *last, double x)
{
    double v = (x - lower) / span, held = 0.0;
    for (int i = 0; i < n; i++) {
        stretch[i] = fmin(fmax(stretch[i] + v - *last, -element[i][0]), element[i][0]);
        held += element[i][1] * stretch[i];
    }
    *last = v;
    return gain * v - held;
}
/* block bouc_wen */
static double h_bouc_wen(double gain, double alpha, double beta, double gamma_, double lower, double span, double *h, double *last, double x)
{
    double v = (x - lower) / span, count = fmin(fmax(ceil(fabs(v - *last) * 200.0), 1.0), 400.0), piece = (v - *last) / count;
    for (int i = 0; i < (int)count; i++) {
        double rate = beta * fabs(piece) + gamma_ * piece * copysign(1.0, *h);
        double middle = *h + 0.5 * (alpha * piece - rate * *h);
        rate = beta * fabs(piece) + gamma_ * piece * copysign(1.0, middle);
        *h += alpha * piece - rate * middle;
    }
    *last = v;
    return gain * v - *h;
}
/* block duhem */
static double h_duhem(double approach, double slope, double elastic, double lower, double span, double *y, double *last, double x)
{
    double v = (x - lower) / span, change = v - *last;
    if (change != 0.0 && approach > 1e-9) {
        double forcing = (elastic - slope) * copysign(1.0, change) / approach;
        *y = slope * v + forcing + (*y - slope * *last - forcing) * exp(-approach * fabs(change));
    } else {
        *y += elastic * change;
    }
    *last = v;
    return *y;
}
/* block drift */
static double h_drift(double rate, double slowing, double *n, double x)
{
    double slowed = slowing * (*n += 1.0);
    return x + rate * (fabs(slowed) < 1e-9 ? *n : -expm1(-slowed) / slowing);
}
/* block lines */
static double h_lines(int count, const double (*line)[3], double *n, double x)
{
    *n += 1.0;
    for (int i = 0; i < count; i++) x += line[i][2] * cos(line[i][0] * *n) + line[i][1] * sin(line[i][0] * *n);
    return x;
}
