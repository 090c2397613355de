/* Floors in compiled loops, for the benchmarks alone: what a program does that is made for one case and checks nothing. */
#include <math.h>
#include <stddef.h>
#include <stdint.h>

/* Lines of whole numbers, apart by blanks, into an array; the count of numbers. */
size_t integers(const char *text, size_t size, int64_t *out)
{
    size_t count = 0, at = 0;
    while (at < size) {
        int64_t value = 0, sign = 1;
        while (at < size && text[at] != '-' && (text[at] < '0' || text[at] > '9')) at++;
        if (at == size) break;
        if (text[at] == '-') { sign = -1; at++; }
        while (at < size && text[at] >= '0' && text[at] <= '9') value = 10 * value + (text[at++] - '0');
        out[count++] = sign * value;
    }
    return count;
}

/* The space profile at t: x, y, normal, curvature, speed (pin circle rp, pin r, K, eccentricity a, zp pins). */
static void profile(double t, const double *g, double *o)
{
    double rp = g[0], r = g[1], K = g[2], a = g[3], zp = g[4];
    double ct = cos(t), st = sin(t), cp = cos(zp * t), sp = sin(zp * t), cf = ct * cp + st * sp;
    double S = 1.0 + K * K - 2.0 * K * cf, root = sqrt(S);
    double k0 = (1.0 + zp * K * K - (1.0 + zp) * K * cf) / (rp * S * root), open = 1.0 - r * k0;
    o[2] = (ct - K * cp) / root; o[3] = (st - K * sp) / root;
    o[0] = rp * ct - a * cp - r * o[2]; o[1] = rp * st - a * sp - r * o[3];
    o[4] = k0 / open; o[5] = rp * root * open;
}

/* Exact flank of a machine whose errors are constant: the wheel stands at T0 + s D (3 x 4 each) for one space, the rays start
   at theta and height z of the work, the space turned by `angle`. Plain Newton in (theta, e, s) with the product's own equations,
   without its safeguards. Returns the most steps taken. */
int flank(const double *T0, const double *D, const double *gear, double E, double angle, size_t n, const double *theta,
          const double *z, double tolerance, double *out)
{
    double ca = cos(angle), sa = sin(angle);
    int most = 0;
    for (size_t i = 0; i < n; i++) {
        double p[6], q[6], t = theta[i], e = 0.0, s = z[i], left = 1.0;
        profile(theta[i], gear, p);
        double x0 = ca * p[0] - sa * p[1], y0 = sa * p[0] + ca * p[1], nx = ca * p[2] - sa * p[3], ny = sa * p[2] + ca * p[3];
        int step = 0;
        while (left > tolerance && step < 80) {
            double R[9], c[3], v[3], w[3], d[3];
            for (int r = 0; r < 3; r++) {
                for (int k = 0; k < 3; k++) R[3 * r + k] = T0[4 * r + k] + s * D[4 * r + k];
                c[r] = T0[4 * r + 3] + s * D[4 * r + 3];
            }
            d[0] = x0 + e * nx - c[0]; d[1] = y0 + e * ny - c[1]; d[2] = z[i] - c[2];
            double point[3], way[3], speed[3];
            for (int k = 0; k < 3; k++) {
                point[k] = R[k] * d[0] + R[3 + k] * d[1] + R[6 + k] * d[2];
                way[k] = R[k] * nx + R[3 + k] * ny;
                speed[k] = R[k] * D[3] + R[3 + k] * D[7] + R[6 + k] * D[11];
            }
            double rho = sqrt(point[0] * point[0] + point[2] * point[2]), cb = -point[0] / rho, sb = point[2] / rho;
            v[0] = way[1]; v[1] = sb * way[2] - cb * way[0]; v[2] = sb * way[0] + cb * way[2];
            w[0] = speed[1]; w[1] = sb * speed[2] - cb * speed[0]; w[2] = sb * speed[0] + cb * speed[2];
            profile(t, gear, q);
            double ax = point[1] - q[1], ra = rho - (E - q[0]);
            double dn = ax * q[3] - ra * q[2], dt = ax * q[2] + ra * q[3];
            double f = w[0] * q[3] - w[1] * q[2], slide = w[0] * q[2] + w[1] * q[3];
            double a = v[0] * q[3] - v[1] * q[2], wt = v[0] * q[2] + v[1] * q[3];
            double bend = w[2] * w[2] / rho * q[2], turning = q[4] * slide, across = turning * wt - q[2] * v[2] * w[2] / rho;
            double pull = f + turning * dt - across * dn / a, grade = bend - turning * slide + across * f / a;
            double least = 0.05 * q[2] / rho;
            if (grade < least) grade = least;
            double ds = -pull / grade, de = (f * ds - dn) / a;
            t += (dt + wt * de - slide * ds) / q[5]; e += de; s += ds;
            left = fabs(de) + grade * ds * ds + fabs(q[4]) * dt * dt;
            step++;
        }
        if (step > most) most = step;
        out[i] = e;
    }
    return most;
}
