/* The program around `begin`, `steps` and `look`. */
static int by_size(const void *a, const void *b) {
    const double x = *(const double *)a, y = *(const double *)b;
    return (x > y) - (x < y);
}

int main(int argc, char **argv) {
    static double times[1000], seen[16];
    if (argc == 4 && strcmp(argv[1], "check") == 0) {
        int i, n;
        begin(atoi(argv[3]));
        steps(atol(argv[2]));
        n = look(seen);
        for (i = 0; i < n; ++i) printf("%.17g\n", seen[i]);
        return 0;
    }
    if (argc == 5 && strcmp(argv[1], "run") == 0) {
        const long n = atol(argv[2]);
        int i, reps = atoi(argv[3]);
        if (reps < 1 || reps > 1000) return 2;
        begin(atoi(argv[4]));
        steps(n / 4 + 1);
        for (i = 0; i < reps; ++i) {
            const double start = nanoseconds();
            steps(n);
            times[i] = nanoseconds() - start;
        }
        qsort(times, (size_t)reps, sizeof *times, by_size);
        /* Whoever reads it also sees that the work was done. */
        i = look(seen);
        printf("%.17g\n%.17g\n", times[reps / 2], i > 0 ? seen[0] : 0.0);
        return 0;
    }
    fprintf(stderr, "usage: %s check STEPS SIZE | run STEPS REPS SIZE\n", argv[0]);
    return 2;
}
